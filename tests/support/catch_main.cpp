// SPDX-License-Identifier: MIT
#define CATCH_CONFIG_MAIN
#include <malloc.h>

#include <catch2/catch.hpp>

// As `rig` does (rig/main.cpp).
[[maybe_unused]] static const bool keeps_freed_memory =
    mallopt(M_MMAP_THRESHOLD, 32 << 20) != 0 && mallopt(M_TRIM_THRESHOLD, 256 << 20) != 0;
