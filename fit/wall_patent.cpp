// SPDX-License-Identifier: MIT
// The patent's methods of fit_wall(): slope of the front wall, circles through the lidar's positions.
#include <Eigen/LU>
#include <algorithm>
#include <functional>
#include <numeric>

#include "fit/angle.hpp"
#include "fit/wall_parts.hpp"

namespace fit::wall_parts {
namespace {

using Eigen::Vector2d;

/// Both walls and the square beams of one scan.
WallObservation observation_of(const Station& station, std::size_t capture, const WallInBench* walls,
                               double yaw, const std::function<double(std::size_t)>& range) {
  WallObservation observation;
  observation.stage_rad = station.stage_rad;
  observation.off_rad = station.off_rad;
  observation.capture = capture;
  for (int j = 0; j < 2; ++j) {
    std::vector<Vector2d> points;
    const double square = walls[j].line.normal_rad - station.stage_rad - station.off_rad - yaw;
    double nearest = 1;
    for (std::size_t k = 0; k < station.beams.size(); ++k) {
      const WallBeam& beam = station.beams[k];
      const double mm = range(k);
      if (beam.wall != j || mm < 20 || std::abs(mm - beam.range) > 150) continue;
      points.emplace_back(mm * std::cos(beam.angle), mm * std::sin(beam.angle));
      const double off = std::abs(wrap_angle(beam.angle - square));
      if (off > 1 * rad_per_deg || off >= nearest) continue;
      nearest = off;
      observation.square_range_mm[j] = mm;
    }
    if (points.size() >= 20) observation.walls[j] = fit_line(points);
  }
  return observation;
}

/// Where the lidar is in the wall frame, from its distances to both walls. The frame's axes point away from
/// the walls and towards them; its origin is the corner.
Vector2d position_from(const WallInBench* walls, double corner, double front_mm, double side_mm) {
  Eigen::Matrix2d normals;
  normals.row(0) = walls[0].line.normal();
  const Line2 side{walls[1].line.normal_rad + corner, 0};
  normals.row(1) = side.normal();
  return normals.inverse() * Vector2d(-front_mm, -side_mm);
}

/// Direction of the offset: the phase at which the positions run round the circle's centre.
Estimate phase_of(const Circle& circle, const std::vector<Vector2d>& points,
                  const std::vector<double>& stages, const std::vector<std::size_t>& inliers, double rms) {
  double c = 0, s = 0;
  for (const std::size_t i : inliers) {
    const Vector2d arm = points[i] - circle.centre;
    const double angle = std::atan2(arm.y(), arm.x()) - stages[i];
    c += std::cos(angle), s += std::sin(angle);
  }
  const double n = std::max<double>(1, static_cast<double>(inliers.size()));
  return {std::atan2(s, c), rms / (std::max(1e-9, circle.radius) * std::sqrt(n))};
}

/// Both circles through the positions: the geometric one after RANSAC, and the algebraic one through the
/// same.
void add_circles(const std::string& way, const std::vector<Vector2d>& points,
                 const std::vector<double>& stages, bool algebraic_too, WallFit& fit) {
  WallCircle geometric{way, std::nullopt, {}, {}, points.size(), 0};
  const auto found = find_circle(points, 20, 10, 2000);
  if (found) {
    geometric.circle = found->fit;
    geometric.inliers = found->inliers.size();
    geometric.radius_mm = {found->fit.circle.radius, std::sqrt(found->fit.covariance(2, 2))};
    geometric.direction_rad = phase_of(found->fit.circle, points, stages, found->inliers, found->fit.rms);
  }
  fit.ways.push_back(geometric);
  if (!found || !algebraic_too) return;
  std::vector<Vector2d> kept;
  for (const std::size_t i : found->inliers) kept.push_back(points[i]);
  WallCircle algebraic = geometric;
  algebraic.way = way + ", algebraic circle";
  algebraic.circle = fit_circle_algebraic(kept);
  algebraic.radius_mm = {algebraic.circle->circle.radius, std::sqrt(algebraic.circle->covariance(2, 2))};
  algebraic.direction_rad =
      phase_of(algebraic.circle->circle, points, stages, found->inliers, algebraic.circle->rms);
  fit.ways.push_back(algebraic);
}

/// The stage angle at which the front wall is nearest, as the patent reads the direction of the offset.
void add_nearest_angle(WallFit& fit) {
  double least = 1e18, at = 0;
  for (const WallObservation& observation : fit.means) {
    if (!observation.walls[0] || observation.walls[0]->line.distance_mm >= least) continue;
    least = observation.walls[0]->line.distance_mm;
    at = observation.stage_rad;
  }
  if (least > 1e17) return;
  WallCircle way{"stage angle at which the front wall is nearest", std::nullopt, {}, {}, fit.means.size(), 0};
  way.direction_rad = {wrap_angle(fit.walls[0].line.normal_rad - at), 0};
  fit.ways.push_back(way);
}

void patent_angle(WallFit& fit) {
  std::vector<double> slopes;
  double from_lines = 0;
  for (const WallObservation& observation : fit.means) {
    if (std::abs(wrap_angle(observation.stage_rad)) > 0.05 * rad_per_deg || !observation.walls[0]) continue;
    slopes.push_back(wrap_angle(fit.walls[0].line.normal_rad - observation.stage_rad - observation.off_rad -
                                observation.walls[0]->line.normal_rad));
    from_lines += observation.walls[0]->covariance(0, 0);
  }
  fit.repeats = slopes.size();
  if (slopes.empty()) return;
  const auto n = static_cast<double>(slopes.size());
  const double mean = std::accumulate(slopes.begin(), slopes.end(), 0.0) / n;
  double squares = 0;
  for (const double slope : slopes) squares += (slope - mean) * (slope - mean);
  const double between = n >= 3 ? std::sqrt(squares / (n - 1) / n) : 0;
  fit.patent_angle_rad = {mean, std::max(between, std::sqrt(from_lines) / n)};
}

}  // namespace

void fit_patent(const std::vector<Station>& stations, WallFit& fit) {
  const double yaw = fit.joint[0];
  std::vector<double> stages, single_stages;
  for (std::size_t i = 0; i < stations.size(); ++i) {
    const Station& station = stations[i];
    const auto observation = [&](const std::function<double(std::size_t)>& range) {
      return observation_of(station, i, fit.walls, yaw, range);
    };
    fit.means.push_back(observation([&](std::size_t k) { return station.beams[k].range; }));
    for (const auto& scan : station.scans) {
      const WallObservation now = observation(
          [&](std::size_t k) { return k < scan.size() ? double(scan[k]) - station.beams[k].off_mm : 0; });
      if (now.walls[0] && now.walls[1]) {
        fit.trajectory.push_back(position_from(fit.walls, fit.joint[5], now.walls[0]->line.distance_mm,
                                               now.walls[1]->line.distance_mm));
        stages.push_back(station.stage_rad + station.off_rad);
      }
      if (now.square_range_mm[0] > 0 && now.square_range_mm[1] > 0) {
        fit.single_beam.push_back(
            position_from(fit.walls, fit.joint[5], now.square_range_mm[0], now.square_range_mm[1]));
        single_stages.push_back(station.stage_rad + station.off_rad);
      }
    }
  }
  patent_angle(fit);
  add_circles("both walls in every scan, geometric circle", fit.trajectory, stages, true, fit);
  add_circles("patent: one square beam a wall, geometric circle", fit.single_beam, single_stages, true, fit);
  add_nearest_angle(fit);
}

}  // namespace fit::wall_parts
