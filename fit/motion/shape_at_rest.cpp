// SPDX-License-Identifier: MIT
#include "fit/motion/shape_at_rest.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

namespace fit {
namespace {

struct Beam {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
};

/// What a lidar saw while it stayed where it was.
struct Stand {
  Pose2 lidar;
  int scans = 0;
  std::map<std::uint32_t, Beam> beams;

  void add(const Sweep& sweep) {
    ++scans;
    for (const SweptPoint& point : sweep.points) {
      Beam& beam = beams[point.beam];
      beam.sum += point.at_mm;
      ++beam.count;
    }
  }
  /// Mean echoes of the beams that mostly had one.
  [[nodiscard]] std::vector<Eigen::Vector2d> means() const {
    std::vector<Eigen::Vector2d> points;
    for (const auto& [index, beam] : beams)
      if (2 * beam.count > scans) points.push_back(beam.sum / beam.count);
    return points;
  }
};

bool same_pose(const Pose2& a, const Pose2& b) {
  constexpr double same_mm = 0.05, same_rad = 5e-5;
  return (a.position() - b.position()).norm() < same_mm && std::abs(a.heading_rad - b.heading_rad) < same_rad;
}

std::vector<Stand> stands_of(std::span<const ShapeAtRest::Scan> scans) {
  std::vector<Stand> stands;
  for (const auto& [sweep, lidar] : scans) {
    if (stands.empty() || !same_pose(stands.back().lidar, lidar)) stands.push_back({lidar, 0, {}});
    stands.back().add(sweep);
  }
  return stands;
}

}  // namespace

ShapeAtRest::ShapeAtRest(std::span<const Scan> scans) {
  std::vector<OrientedPoint> surface;
  for (const Stand& stand : stands_of(scans))
    for (const OrientedPoint& point : orient_sweep(stand.means()))
      surface.push_back(
          {stand.lidar * point.at_mm, Eigen::Rotation2Dd(stand.lidar.heading_rad) * point.normal});
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
