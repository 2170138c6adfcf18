// SPDX-License-Identifier: MIT
#include "sim/engine.hpp"
