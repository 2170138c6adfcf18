// SPDX-License-Identifier: MIT
#include "rig/session/targets_in_view.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/numeric/angle.hpp"

namespace rig {

using nlohmann::json;

json target_in_view(const fit::Target& target, const fit::Bench& bench, double stage_deg) {
  const double stage_rad = stage_deg * fit::rad_per_deg;
  const fit::Mount& mount = bench.lidar.mount;
  const Eigen::Vector2d origin =
      Eigen::Rotation2Dd(stage_rad) * Eigen::Vector2d(mount.x_mm.value, mount.y_mm.value);
  const Eigen::Rotation2Dd to_lidar(-stage_rad - mount.yaw_rad.value);
  json ends = json::array();
  for (const Eigen::Vector2d& end : {target.from_mm, target.to_mm}) {
    const Eigen::Vector2d seen = to_lidar * (end - origin);
    ends.push_back({std::round(seen.x()), std::round(seen.y())});
  }
  return ends;
}

json targets_in_view(const fit::Bench& bench, double stage_deg) {
  json list = json::array();
  for (const fit::Target& target : bench.targets) list.push_back(target_in_view(target, bench, stage_deg));
  return list;
}

}  // namespace rig
