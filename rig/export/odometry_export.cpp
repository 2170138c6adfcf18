// SPDX-License-Identifier: MIT
#include "rig/export/odometry_export.hpp"

#include <cmath>
#include <fstream>

#include "fit/numeric/angle.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/errors.hpp"
#include "rig/json_fields.hpp"
#include "rig/whole_file.hpp"

namespace rig {
namespace {

using nlohmann::json;

json result_of(const ExportSource& source) {
  if (source.session) {
    const auto result = source.session->latest_result("odometry");
    if (!result)
      throw MeasurementError(source.path + " holds no calibration of its odometry: run 'rig fit odometry " +
                             source.path + "' first");
    return json::parse(*result, nullptr, false);
  }
  std::ifstream in(source.path, std::ios::binary);
  if (!in) throw UsageError("cannot read " + source.path + ": no such file, or no permission");
  json result = json::parse(in, nullptr, false);
  if (text_of(result, "kind") != "odometry")
    throw UsageError(
        source.path +
        " is not a result of 'rig fit odometry': give a session that holds one, or the file that its "
        "--json FILE wrote");
  return result;
}

OdometryExport::Value value_of(const json& result, const std::string& path, const std::string& name,
                               double scale) {
  for (const json& value : list_of(result, "values")) {
    if (text_of(value, "name") != name) continue;
    const OdometryExport::Value out{number_of(value, "value") * scale, expanded_of(value) * scale};
    if (std::isfinite(out.value) && std::isfinite(out.expanded)) return out;
  }
  std::string why;
  for (const json& sentence : list_of(result, "undetermined"))
    if (sentence.is_string()) why += " " + sentence.get<std::string>();
  throw MeasurementError(path + ": its odometry's result does not determine " + name + "." + why);
}

std::string with_uncertainty(const OdometryExport::Value& value, const char* unit) {
  return fit::format_value(value.value, value.expanded) + " " + unit +
         " (U = " + fit::format_uncertainty(value.expanded) + " " + unit + ", k = 2)";
}

}  // namespace

OdometryExport read_odometry(const ExportSource& source) {
  OdometryExport out;
  out.result = result_of(source);
  const auto read = [&](const char* name, double scale = 1) {
    return value_of(out.result, source.path, name, scale);
  };
  out.left_radius_mm = read("left_radius_mm");
  out.right_radius_mm = read("right_radius_mm");
  out.separation_mm = read("separation_mm");
  out.lidar_x_mm = read("lidar_x_mm");
  out.lidar_y_mm = read("lidar_y_mm");
  out.lidar_yaw_rad = read("lidar_yaw_deg", fit::rad_per_deg);
  return out;
}

void OdometryFormat::write(const ExportSource& source, const std::string& output) const {
  write_text(output, text_of(read_odometry(source)));
}

std::string in_metres(const OdometryExport::Value& mm) {
  return with_uncertainty({mm.value / 1000, mm.expanded / 1000}, "m");
}
std::string in_radians(const OdometryExport::Value& rad) { return with_uncertainty(rad, "rad"); }

}  // namespace rig
