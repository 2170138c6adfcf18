// SPDX-License-Identifier: MIT
#include "fit/shape_at_rest.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

namespace fit {

void ShapeAtRest::add(const Sweep& scan, const Pose2& lidar) {
  constexpr double same_mm = 0.05, same_rad = 5e-5;
  const bool same = !stands_.empty() &&
                    (stands_.back().lidar.position() - lidar.position()).norm() < same_mm &&
                    std::abs(stands_.back().lidar.heading_rad - lidar.heading_rad) < same_rad;
  if (!same) stands_.push_back({lidar, 0, {}});
  Stand& stand = stands_.back();
  ++stand.scans;
  for (const SweptPoint& point : scan.points) {
    Beam& beam = stand.beams[point.beam];
    beam.sum += point.at_mm;
    ++beam.count;
  }
}

void ShapeAtRest::finish() {
  std::vector<OrientedPoint> surface;
  for (const Stand& stand : stands_) {
    std::vector<Eigen::Vector2d> means;
    for (const auto& [index, beam] : stand.beams)
      if (2 * beam.count > stand.scans) means.push_back(beam.sum / beam.count);
    for (const OrientedPoint& point : orient_sweep(means))
      surface.push_back(
          {stand.lidar * point.at_mm, Eigen::Rotation2Dd(stand.lidar.heading_rad) * point.normal});
  }
  surface_ = PointCloud(std::move(surface));
}

double ShapeAtRest::distance_of(std::span<const Eigen::Vector2d> points, const Pose2& guess) const {
  constexpr double reach_mm = 60;
  constexpr int enough = 50;
  IcpOptions all;
  all.most_points = points.size();
  const IcpResult placed = match_to_lines(surface_, points, guess, {}, all);
  double squares = 0;
  int count = 0;
  for (const Eigen::Vector2d& point : points) {
    const Eigen::Vector2d at = placed.pose * point;
    const OrientedPoint* near = surface_.nearest(at, reach_mm);
    if (!near || near->normal.isZero()) continue;
    const double off = near->normal.dot(at - near->at_mm);
    squares += off * off;
    ++count;
  }
  return count < enough ? std::numeric_limits<double>::quiet_NaN() : std::sqrt(squares / count);
}

}  // namespace fit
