// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/numeric/number_format.hpp"
#include "rig/export/odometry_export.hpp"

namespace rig::exporters {
namespace {

std::string metres(double mm) { return fit::format_exactly(std::round(mm * 1e3) / 1e6); }

std::string fixed_joint(const OdometryExport& what) {
  return "  <link name=\"laser\"/>\n"
         "  <!-- x " +
         in_metres(what.lidar_x_mm) + ", y " + in_metres(what.lidar_y_mm) + ", yaw " +
         in_radians(what.lidar_yaw_rad) +
         " -->\n"
         "  <joint name=\"laser_joint\" type=\"fixed\">\n"
         "    <parent link=\"base_link\"/>\n    <child link=\"laser\"/>\n    <origin xyz=\"" +
         metres(what.lidar_x_mm.value) + " " + metres(what.lidar_y_mm.value) + " 0\" rpy=\"0 0 " +
         fit::format_exactly(std::round(what.lidar_yaw_rad.value * 1e6) / 1e6) + "\"/>\n  </joint>\n";
}

std::string wheel(const std::string& side, const OdometryExport::Value& radius_mm, double y_mm) {
  return "  <!-- radius " + in_metres(radius_mm) + " -->\n  <link name=\"" + side +
         "_wheel\">\n    <collision>\n      <geometry><cylinder radius=\"" + metres(radius_mm.value) +
         "\" length=\"0.01\"/></geometry>\n    </collision>\n  </link>\n"
         "  <joint name=\"" +
         side + "_wheel_joint\" type=\"continuous\">\n    <parent link=\"base_link\"/>\n    <child link=\"" +
         side + "_wheel\"/>\n    <origin xyz=\"0 " + metres(y_mm) +
         " 0\" rpy=\"-1.570796 0 0\"/>\n    <axis xyz=\"0 0 1\"/>\n  </joint>\n";
}

/// A robot of its own, from which links and joints are taken over.
class Urdf : public OdometryFormat {
 public:
  std::string format() const override { return "urdf"; }
  std::string describes() const override { return "lidar pose and wheels from rig fit odometry, as URDF"; }

 private:
  std::string text_of(const OdometryExport& what) const override {
    const double half_mm = what.separation_mm.value / 2;
    return "<?xml version=\"1.0\"?>\n"
           "<!-- Calibrated by rig " RIG_VERSION
           ". base_link lies midway between the wheels, x ahead, y to the left;\n"
           "     heights (z) and the wheels' width were not measured. Wheel separation " +
           in_metres(what.separation_mm) +
           " -->\n<robot name=\"calibrated\">\n  <link name=\"base_link\"/>\n" + fixed_joint(what) +
           wheel("left", what.left_radius_mm, half_mm) + wheel("right", what.right_radius_mm, -half_mm) +
           "</robot>\n";
  }
};

}  // namespace

std::unique_ptr<Exporter> make_urdf() { return std::make_unique<Urdf>(); }

}  // namespace rig::exporters
