// SPDX-License-Identifier: MIT
#include "fit/motion/map_fusion.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <unordered_map>

#include "fit/numeric/dense.hpp"
#include "fit/numeric/median.hpp"

namespace fit {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

}  // namespace

struct Fusion::Map {
  explicit Map(double cell) : cell_mm(cell) {}

  /// The first points of a cell stay: a map that drifts with what is added to it would hide the drift.
  void add(std::span<const Vector2d> sweep) {
    for (const OrientedPoint& point : orient_sweep(sweep)) {
      const auto ix = static_cast<std::int64_t>(std::floor(point.at_mm.x() / cell_mm));
      const auto iy = static_cast<std::int64_t>(std::floor(point.at_mm.y() / cell_mm));
      int& held = cells[(ix << 32) ^ (iy & 0xffffffff)];
      if (held >= 3 || point.normal.isZero()) continue;
      ++held;
      points.push_back(point);
    }
    cloud = PointCloud(points);
  }

  double cell_mm;
  std::unordered_map<std::int64_t, int> cells;
  std::vector<OrientedPoint> points;
  PointCloud cloud;
};

Fusion::Fusion(Path path, const Pose2& lidar, FusionOptions options)
    : path_(std::move(path)),
      lidar_(lidar),
      carried_covariance_(Vector3d(1, 1, 1e-6).asDiagonal()),
      options_(options),
      map_(std::make_unique<Map>(options.cell_mm)) {}

Fusion::~Fusion() = default;

const PointCloud& Fusion::map() const { return map_->cloud; }

FusedSweep Fusion::add(const Sweep& sweep) {
  const SweepTiming& timing = options_.timing;
  const Pose2 begin = carried_ * path_.at(sweep.begin_s + timing.offset_s) * lidar_;
  const Pose2 end = carried_ * path_.at(sweep.time_s(1) + timing.offset_s) * lidar_;
  std::vector<SpreadPoint> points;
  points.reserve(sweep.points.size());
  for (const SweptPoint& p : sweep.points)
    points.push_back({carried_ * (path_.at(timing.path_time(sweep, p.share)) * (lidar_ * p.at_mm)),
                      timing.reversed ? 1 - p.share : p.share});

  const double way = (end.position() - begin.position()).norm();
  const double turn = std::abs(end.heading_rad - begin.heading_rad);
  SpreadPrior prior;
  prior.start_covariance = carried_covariance_ + Eigen::Matrix3d(Vector3d(0.25, 0.25, 1e-7).asDiagonal());
  const double u_mm = options_.odometry_u_mm + options_.odometry_u * way;
  prior.growth_u = {u_mm, u_mm, options_.odometry_u_rad + options_.odometry_u * turn};
  const SpreadResult match = map_->points.empty()
                                 ? SpreadResult{}
                                 : match_spread(map_->cloud, points, begin.position(), prior, options_.icp);

  FusedSweep fused;
  fused.matched = match.pairs >= 10;
  SpreadCorrection correction = match.correction;
  correction.pivot = begin.position();
  if (!fused.matched) correction = {begin.position(), Vector3d::Zero(), Vector3d::Zero()};
  fused.noise_mm = match.noise_mm;
  fused.observability = match.observability;
  fused.iterations = match.iterations;
  fused.begin = correction.at(0) * begin;
  fused.end = correction.at(1) * end;
  fused.map_mm.reserve(points.size());
  for (const SpreadPoint& point : points) fused.map_mm.push_back(correction.apply(point));
  carried_ = correction.at(1) * carried_;
  if (fused.matched) carried_covariance_ = match.end_covariance;

  const bool moved =
      !last_keyframe_ ||
      (fused.begin.position() - last_keyframe_->position()).norm() > options_.keyframe_mm ||
      std::abs(wrap_angle(fused.begin.heading_rad - last_keyframe_->heading_rad)) > options_.keyframe_rad;
  if (moved) {
    map_->add(fused.map_mm);
    last_keyframe_ = fused.begin;
  }
  return fused;
}

// --- crispness --------------------------------------------------------------------------------------------

Crispness crispness(std::span<const Vector2d> map, double radius_mm, std::size_t most) {
  // Of a map of many points some say as much about walls as all.
  constexpr std::size_t enough = 50'000;
  const std::size_t thinned = std::max<std::size_t>(1, map.size() / enough);
  std::vector<OrientedPoint> points;
  points.reserve(map.size() / thinned + 1);
  for (std::size_t i = 0; i < map.size(); i += thinned) points.push_back({map[i], Vector2d::Zero()});
  const PointCloud cloud(std::move(points));
  const std::size_t stride = std::max<std::size_t>(1, map.size() / std::max<std::size_t>(1, most));
  std::vector<double> thick;
  double entropy = 0;
  for (std::size_t i = 0; i < map.size(); i += stride) {
    const auto near = cloud.within(map[i], radius_mm);
    if (near.size() < 10) continue;
    Vector2d mean = Vector2d::Zero();
    for (const std::size_t k : near) mean += cloud.points()[k].at_mm - map[i];
    mean /= static_cast<double>(near.size());
    Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
    for (const std::size_t k : near) {
      const Vector2d d = cloud.points()[k].at_mm - map[i] - mean;
      spread += d * d.transpose();
    }
    spread /= static_cast<double>(near.size());
    const Eigen::VectorXd values = dense::symmetric_eigen(spread).values;
    const double across = std::sqrt(std::max(0.25, values[0]));
    const double along = std::sqrt(std::max(0.25, values[1]));
    entropy += std::log(across * along) + std::log(2 * pi * std::exp(1.0));
    if (along > 0.3 * radius_mm) thick.push_back(across);
  }
  Crispness result;
  result.judged = thick.size();
  if (thick.empty()) return result;
  result.entropy = entropy / static_cast<double>((map.size() + stride - 1) / stride);
  result.mean_thickness_mm =
      std::accumulate(thick.begin(), thick.end(), 0.0) / static_cast<double>(thick.size());
  result.thickness_mm = median_of(std::span(thick));
  return result;
}

}  // namespace fit
