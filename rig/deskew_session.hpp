// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

namespace rig {

/// What the operator asked of `rig deskew`.
struct DeskewRequest {
  std::string input, output;
  std::optional<double> offset_ms;  ///< Path time minus scan time; without it, it is estimated.
  std::optional<bool> reversed;     ///< Beams listed against their order in time; without it, judged.
  bool fuse = true;                 ///< Odometry with ICP; false: odometry alone.
  double odometry_u = 0.1;          ///< Relative standard uncertainty of odometry over one scan.
};

/// Removes the motion distortion of a session and writes a new one: its captures and scans as they are, the
/// lidar carrier's corrected poses as its track, a table
/// `deskewed(capture, seq, x_mm, y_mm, heading_deg, points)` with each scan's lidar pose in the map at the
/// scan's beginning and its points in the lidar's frame at that moment (little-endian float32 pairs, one a
/// beam, NaN without echo), and the result `deskew` with pictures of the map and its crispness. Returns that
/// result. Throws UsageError (files) or MeasurementError (no motion known).
nlohmann::json deskew_session(const DeskewRequest& request);

}  // namespace rig
