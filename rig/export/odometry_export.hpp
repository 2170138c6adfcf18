// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "rig/export/exporter.hpp"

namespace rig {

/// What `rig fit odometry` found, for robots: millimetres and radians, and each with its expanded uncertainty
/// (k = 2). The lidar on the robot as docs/method/moving.md has it: x ahead, y to the left, from midway
/// between the wheels.
struct OdometryExport {
  struct Value {
    double value = 0, expanded = 0;
  };
  Value left_radius_mm, right_radius_mm, separation_mm, lidar_x_mm, lidar_y_mm, lidar_yaw_rad;
  nlohmann::json result;  ///< The whole document (docs/reference/result.md).
};

/// A format of `rig export` that is a text made from the result of `rig fit odometry`: from a session that
/// holds one, or from the file that its --json wrote.
class OdometryFormat : public Exporter {
 public:
  bool accepts_files() const final { return true; }
  void write(const ExportSource& source, const std::string& output) const final;

 private:
  [[nodiscard]] virtual std::string text_of(const OdometryExport& what) const = 0;
};

/// Throws MeasurementError when there is no such result, or it leaves a value undetermined (which, and why).
[[nodiscard]] OdometryExport read_odometry(const ExportSource& source);

/// "0.0330 m (U = 0.0002 m, k = 2)" for comments: in metres or radians, to the uncertainty's second digit.
[[nodiscard]] std::string in_metres(const OdometryExport::Value& mm);
[[nodiscard]] std::string in_radians(const OdometryExport::Value& rad);

}  // namespace rig
