// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "rig/fitting/deskewing.hpp"
#include "rig/output_place.hpp"

namespace rig {

/// Removes the motion distortion of the session `input` and writes a new one, `output`: its captures and
/// scans as they are, the lidar carrier's corrected poses as its track, a table `deskewed(capture, seq, x_mm,
/// y_mm, heading_deg, points)` with each scan's lidar pose in the map at the scan's beginning and its points
/// in the lidar's frame at that moment (little-endian float32 pairs, one a beam, NaN without echo), and the
/// result `deskew` with pictures of the map and its crispness. It appears whole or not at all. Returns that
/// result. Throws UsageError (files) or MeasurementError (no motion known).
nlohmann::json deskew_session(const std::string& input, const OutputPlace& output,
                              const DeskewOptions& options);

}  // namespace rig
