// SPDX-License-Identifier: MIT
#include "rig/export/odometry_export.hpp"

namespace rig::exporters {
namespace {

using nlohmann::json;

/// `odometry/1` (docs/reference/export.md): what a program needs of the result, and nothing of how it came
/// about.
class Odometry : public OdometryFormat {
 public:
  std::string format() const override { return "odometry"; }
  std::string describes() const override { return "wheels and lidar pose from rig fit odometry, as JSON"; }

 private:
  std::string text_of(const OdometryExport& what) const override {
    json values = json::object();
    for (const json& value : what.result.at("values"))
      values[value.at("name").get<std::string>()] = {
          {"value", value.at("value")}, {"u", value.value("u", json())}, {"unit", value.value("unit", "")}};
    const json out = {
        {"schema", "odometry/1"},
        {"software", "rig " RIG_VERSION},
        {"frame", "midway between the wheels, x ahead, y to the left, angles counter-clockwise"},
        {"values", values},
        {"covariance", what.result.value("covariance", json())},
        {"undetermined", what.result.value("undetermined", json::array())},
        {"notes", what.result.value("notes", json::array())}};
    return out.dump(2) + "\n";
  }
};

}  // namespace

std::unique_ptr<Exporter> make_odometry() { return std::make_unique<Odometry>(); }

}  // namespace rig::exporters
