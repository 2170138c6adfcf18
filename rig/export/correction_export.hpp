// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>

#include "fit/correction.hpp"
#include "rig/export/exporter.hpp"

namespace rig {

/// The rotation centre that goes with a correction, if the session knows it (lidar frame).
struct ExportCentre {
  double x_mm = 0, y_mm = 0;
  bool calibrated = false;
};

/// What the correction formats are made from: a correction file, or a session with a range calibration.
struct CorrectionExport {
  fit::Correction correction;
  ExportCentre centre;
};
[[nodiscard]] CorrectionExport read_for_export(const ExportSource& source);

/// C99 without dependencies: error, correction, state flags, equations 13/17 of source A
/// (docs/correction.md).
[[nodiscard]] std::string c_header(const CorrectionExport& what);
/// C++11 without dependencies: the same with uncertainty.
[[nodiscard]] std::string cpp_header(const CorrectionExport& what);
/// A grid over range and intensity, for bilinear interpolation.
[[nodiscard]] std::string csv_table(const fit::Correction& correction);
/// A parameter file for any ROS 2 node.
[[nodiscard]] std::string ros2_parameters(const CorrectionExport& what);

/// Writes text to a file; throws UsageError or MeasurementError.
void write_text(const std::string& output, const std::string& text);

}  // namespace rig
