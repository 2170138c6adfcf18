// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <vector>

namespace lidar {

/// What a SCIP lidar says of one scan, codes already turned to 0 (no echo). One value for each cluster of
/// steps.
struct Scan {
  std::uint64_t device_ms = 0;  ///< The lidar's own stamp, 24-bit wraps undone.
  std::int64_t host_us = 0;     ///< Host time (monotonic, microseconds) at which step 0 was passed.
  int first_step = 0, last_step = 0, cluster = 1;
  std::vector<std::uint16_t> range_mm;
  std::vector<std::uint16_t> intensity;  ///< Empty for commands without intensity.
};

}  // namespace lidar
