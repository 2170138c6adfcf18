// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

namespace lidar {

/// How the lidar's clock stands to the host's: host = host_us + (device - device_ms) * 1000 * (1 - drift_ppm
/// * 1e-6).
struct ClockEstimate {
  bool synchronised = false;  ///< From TM exchanges; else only from when scans arrived.
  bool follows_host =
      true;  ///< False when a device second is not a host second within 1 %: a simulator at full speed or a
             ///< broken clock. Scan times then follow the device's clock 1:1 from the anchor.
  double device_ms = 0;    ///< The anchor, device side (24-bit wraps undone).
  double host_us = 0;      ///< The anchor, host side.
  double offset_u_us = 0;  ///< Standard uncertainty of host_us.
  double drift_ppm = 0;    ///< How much faster than the host's the device's clock runs.
  double drift_u_ppm = 0;  ///< Standard uncertainty of drift_ppm.
  int exchanges = 0;       ///< TM exchanges used.
  int resets = 0;          ///< Times the device's timer was found to have started again.
};

}  // namespace lidar
