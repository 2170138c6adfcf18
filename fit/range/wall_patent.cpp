// SPDX-License-Identifier: MIT
// The patent's methods of fit_wall(): slope of the front wall, circles through the lidar's positions.
#include <Eigen/LU>
#include <algorithm>
#include <functional>
#include <map>
#include <numeric>

#include "fit/numeric/angle.hpp"
#include "fit/range/wall_parts.hpp"

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

/// Positions of the lidar, each with the stage angle and the capture that it comes from.
struct Positions {
  std::vector<Vector2d> at;
  std::vector<double> stages;
  std::vector<std::size_t> captures;

  void add(const Vector2d& position, double stage_rad, std::size_t capture) {
    at.push_back(position), stages.push_back(stage_rad), captures.push_back(capture);
  }
};

/// What the positions of a capture share counts once for all of them: the sandwich over captures, as of the
/// joint fit. Scores are what a position's residual adds to the gradient, by capture.
template <class Vector>
auto between_captures(const std::map<std::size_t, Vector>& scores) {
  const auto captures = static_cast<double>(scores.size());
  Eigen::Matrix<double, Vector::RowsAtCompileTime, Vector::RowsAtCompileTime> sum;
  sum.setZero();
  for (const auto& [capture, score] : scores) sum += score * score.transpose();
  return (sum * (captures > 1 ? captures / (captures - 1) : 1)).eval();
}

double u_of_radius(const CircleFit& fit, const Positions& positions,
                   const std::vector<std::size_t>& inliers) {
  std::map<std::size_t, Eigen::Vector3d> scores;
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  for (const std::size_t i : inliers) {
    const Vector2d arm = positions.at[i] - fit.circle.centre;
    Eigen::Vector3d slope;
    slope << arm.normalized(), 1;
    information += slope * slope.transpose();
    scores.try_emplace(positions.captures[i], Eigen::Vector3d::Zero()).first->second +=
        slope * (arm.norm() - fit.circle.radius);
  }
  const Eigen::Matrix3d inverse = information.inverse();
  const double shared = (inverse * between_captures(scores) * inverse)(2, 2);
  return std::sqrt(std::isfinite(shared) ? std::max(fit.covariance(2, 2), shared) : fit.covariance(2, 2));
}

/// Direction of the offset: the phase at which the positions run round the circle's centre.
Estimate phase_of(const CircleFit& fit, const Positions& positions, const std::vector<std::size_t>& inliers) {
  const auto phase = [&](std::size_t i) {
    const Vector2d arm = positions.at[i] - fit.circle.centre;
    return std::atan2(arm.y(), arm.x()) - positions.stages[i];
  };
  double c = 0, s = 0;
  for (const std::size_t i : inliers) c += std::cos(phase(i)), s += std::sin(phase(i));
  const double mean = std::atan2(s, c), n = std::max<double>(1, static_cast<double>(inliers.size()));
  std::map<std::size_t, Eigen::Matrix<double, 1, 1>> scores;
  for (const std::size_t i : inliers)
    scores.try_emplace(positions.captures[i], Eigen::Matrix<double, 1, 1>::Zero()).first->second[0] +=
        std::sin(phase(i) - mean) / n;
  const double by_noise = fit.rms / (std::max(1e-9, fit.circle.radius) * std::sqrt(n));
  return {mean, std::max(by_noise, std::sqrt(between_captures(scores)(0, 0)))};
}

/// Both circles through the positions: the geometric one after RANSAC, and the algebraic one through the
/// same.
void add_circles(const std::string& way, const Positions& positions, WallFit& fit) {
  WallCircle geometric{way + ", geometric circle", std::nullopt, {}, {}, positions.at.size(), 0};
  const auto found = find_circle(positions.at, 20, 10, 2000);
  const auto complete = [&](WallCircle& to, const CircleFit& circle) {
    to.circle = circle;
    to.inliers = found->inliers.size();
    to.radius_mm = {circle.circle.radius, u_of_radius(circle, positions, found->inliers)};
    to.direction_rad = phase_of(circle, positions, found->inliers);
  };
  if (found) complete(geometric, found->fit);
  fit.ways.push_back(geometric);
  if (!found) return;
  std::vector<Vector2d> kept;
  for (const std::size_t i : found->inliers) kept.push_back(positions.at[i]);
  WallCircle algebraic = geometric;
  algebraic.way = way + ", algebraic circle";
  complete(algebraic, fit_circle_algebraic(kept));
  fit.ways.push_back(algebraic);
}

/// A capture as it was measured: without what was taken off.
Station as_measured(const Station& station) {
  Station raw;
  raw.stage_rad = station.stage_rad, raw.approach = station.approach, raw.beams = station.beams;
  for (WallBeam& beam : raw.beams) beam.range += beam.off_mm, beam.angle -= beam.off_rad;
  return raw;
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
  Positions both, single;
  for (std::size_t i = 0; i < stations.size(); ++i) {
    const Station &station = stations[i], raw = as_measured(station);
    const auto mean_of = [&](const Station& of) {
      return observation_of(of, i, fit.walls, yaw, [&](std::size_t k) { return of.beams[k].range; });
    };
    fit.means.push_back(mean_of(station));
    fit.measured.push_back(mean_of(raw));
    const double stage = station.stage_rad + station.off_rad;
    for (const auto& scan : station.scans) {
      const WallObservation now = observation_of(station, i, fit.walls, yaw, [&](std::size_t k) {
        return k < scan.size() ? double(scan[k]) - station.beams[k].off_mm : 0;
      });
      if (now.walls[0] && now.walls[1])
        both.add(position_from(fit.walls, fit.joint[5], now.walls[0]->line.distance_mm,
                               now.walls[1]->line.distance_mm),
                 stage, i);
      if (now.square_range_mm[0] > 0 && now.square_range_mm[1] > 0)
        single.add(position_from(fit.walls, fit.joint[5], now.square_range_mm[0], now.square_range_mm[1]),
                   stage, i);
    }
  }
  patent_angle(fit);
  add_circles("both walls in every scan", both, fit);
  add_circles("patent: one square beam a wall", single, fit);
  fit.trajectory = std::move(both.at), fit.single_beam = std::move(single.at);
  add_nearest_angle(fit);
}

}  // namespace fit::wall_parts
