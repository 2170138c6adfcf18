// SPDX-License-Identifier: MIT
#include "rig/stage.hpp"
