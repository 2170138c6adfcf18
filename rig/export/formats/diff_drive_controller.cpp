// SPDX-License-Identifier: MIT
#include <cmath>

#include "rig/export/correction_export.hpp"
#include "rig/export/odometry_export.hpp"

namespace rig::exporters {
namespace {

/// Parameters of ros2_control's diff_drive_controller. It knows one radius and a multiplier for each wheel.
class DiffDriveController : public OdometryFormat {
 public:
  std::string format() const override { return "diff-drive-controller"; }
  std::string describes() const override {
    return "wheels from rig fit odometry, as parameters of ros2_control's diff_drive_controller";
  }

 private:
  std::string text_of(const OdometryExport& what) const override {
    const double left_mm = what.left_radius_mm.value, right_mm = what.right_radius_mm.value;
    const double mean_mm = (left_mm + right_mm) / 2;
    return "# Calibrated by rig " RIG_VERSION ". Left wheel's radius " + in_metres(what.left_radius_mm) +
           ",\n# right wheel's radius " + in_metres(what.right_radius_mm) + ",\n# wheel separation " +
           in_metres(what.separation_mm) +
           ".\ndiff_drive_controller:\n  ros__parameters:\n"
           "    left_wheel_names: [\"left_wheel_joint\"]\n    right_wheel_names: [\"right_wheel_joint\"]\n"
           "    wheel_separation: " +
           real(what.separation_mm.value / 1000) + "\n    wheel_radius: " + real(mean_mm / 1000) +
           "\n    wheel_separation_multiplier: 1.0\n    left_wheel_radius_multiplier: " +
           real(left_mm / mean_mm) + "\n    right_wheel_radius_multiplier: " + real(right_mm / mean_mm) +
           "\n";
  }
};

}  // namespace

std::unique_ptr<Exporter> make_diff_drive_controller() { return std::make_unique<DiffDriveController>(); }

}  // namespace rig::exporters
