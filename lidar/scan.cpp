// SPDX-License-Identifier: MIT
#include "lidar/scan.hpp"
