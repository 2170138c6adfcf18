// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rig/import/importer.hpp"
#include "rig/output_place.hpp"

namespace rig {

/// What the operator asked of `rig import`.
struct ImportRequest {
  std::vector<std::string> files;  ///< One capture each.
  OutputPlace output;
  ImportOptions options;
  std::optional<std::string> bench;  ///< Text of a bench file; without it one is made from the recording.
  std::string target = "wall";
  std::vector<double> true_mm;  ///< True distance of the target for each file; empty: guessed from the names.
  double true_u_mm = 5;
  double target_width_mm = 600;
  bool accept_doubts = false;  ///< Import what is not plausible all the same, and note why it is not.
};

struct ImportReport {
  std::uint64_t captures = 0, scans = 0, poses = 0;
  std::vector<std::string> notes;  ///< Sentences for the operator, each once.
};

/// Reads the files, one capture each, into a new session. What is damaged is left out and reported. A file
/// without a single scan is welcome when it tells wheels or poses: they join the track of the others; else it
/// is refused (MeasurementError) and no session left behind. So are scans that are not plausible
/// (Plausibility), and a track that lies in another time than the scans. Nothing is resampled: scans that
/// differ keep their own geometry (`scan_geometry`).
///
/// With true distances, the session's bench has a flat target square to the x axis at the first of them, and
/// every capture the shift that puts it at its own: what `rig fit range` and `rig explain` need. Beside the
/// tables of docs/reference/session.md it writes `imu(host_us, yaw_deg, rate_deg_s)`, and the session keys
/// `import`, `transforms` and `lidar_on_robot` (docs/operate/import.md).
ImportReport import_session(const ImportRequest& request);

/// The distance that a file's name, or its folder's, tells ("wall_0.5m", "1500mm_0.mcap"), in millimetres.
[[nodiscard]] std::optional<double> distance_in_name(const std::string& path);

}  // namespace rig
