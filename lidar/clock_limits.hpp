// SPDX-License-Identifier: MIT
#pragma once
// How far a lidar's clock may be from the host's, and a stamp late, before something else is at fault.

namespace lidar {

constexpr double rate_tolerance = 0.01;     // beyond, the lidar's second is no second of the host's
constexpr double longest_stall_ms = 30000;  // what buffers on the way can hold, and more

}  // namespace lidar
