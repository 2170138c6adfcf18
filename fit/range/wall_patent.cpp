// SPDX-License-Identifier: MIT
// The patent's methods of fit_wall(): slope of the front wall, circles through the lidar's positions.
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <functional>
#include <map>
#include <numeric>
#include <random>

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

/// Direction of the offset: the phase at which the positions run round the circle's centre.
double phase_of(const Circle& circle, const Positions& positions, const std::vector<std::size_t>& inliers) {
  double c = 0, s = 0;
  for (const std::size_t i : inliers) {
    const Vector2d arm = positions.at[i] - circle.centre;
    const double phase = std::atan2(arm.y(), arm.x()) - positions.stages[i];
    c += std::cos(phase), s += std::sin(phase);
  }
  return std::atan2(s, c);
}

/// Both circles through the positions: the geometric one after RANSAC, and the algebraic one through the
/// same.
struct Circles {
  CircleFit geometric, algebraic;
  std::vector<std::size_t> inliers;
};

std::optional<Circles> circles_through(const Positions& positions) {
  auto found = find_circle(positions.at, 20, 10, 2000);
  if (!found) return std::nullopt;
  std::vector<Vector2d> kept;
  for (const std::size_t i : found->inliers) kept.push_back(positions.at[i]);
  return Circles{found->fit, fit_circle_algebraic(kept), std::move(found->inliers)};
}

/// How far circles lie from the truth, by imitation. The selection keeps what lies near the circle that it
/// ends with, and noise across a short radius lengthens it: what the kept positions scatter says nothing of
/// either.
class Imitations {
 public:
  /// The positions that the joint fit expects, with what the measured ones deviate from theirs. A capture
  /// takes another's deviations, as those of one capture may go together.
  Imitations(const Positions& positions, const WallFit& fit) : truth_(fit.joint.segment<2>(1)) {
    std::mt19937_64 random(1);
    const Vector2d axis = position_from(fit.walls, fit.joint[5], fit.joint[3], fit.joint[4]);
    Positions imitated = positions;
    std::map<std::size_t, std::vector<Vector2d>> of_capture;
    for (std::size_t i = 0; i < positions.at.size(); ++i) {
      imitated.at[i] = axis + Eigen::Rotation2Dd(positions.stages[i]) * truth_;
      of_capture[positions.captures[i]].push_back(positions.at[i] - imitated.at[i]);
    }
    widen(of_capture);
    std::vector<const std::vector<Vector2d>*> pools;
    for (const auto& [capture, deviations] : of_capture) pools.push_back(&deviations);
    const std::vector<Vector2d> expected = imitated.at;
    constexpr int imitations = 60;  // u to a tenth of itself
    for (int k = 0; k < imitations && !pools.empty(); ++k) {
      std::map<std::size_t, const std::vector<Vector2d>*> taken;
      for (const auto& [capture, deviations] : of_capture) taken[capture] = pools[random() % pools.size()];
      for (std::size_t i = 0; i < expected.size(); ++i) {
        const std::vector<Vector2d>& from = *taken.at(positions.captures[i]);
        imitated.at[i] = expected[i] + from[random() % from.size()];
      }
      const auto circles = circles_through(imitated);
      if (!circles) continue;
      geometric_.add(circles->geometric.circle,
                     phase_of(circles->geometric.circle, imitated, circles->inliers), truth_);
      algebraic_.add(circles->algebraic.circle,
                     phase_of(circles->algebraic.circle, imitated, circles->inliers), truth_);
    }
  }
  /// Root mean square of the errors, 0 where there are none: scatter and bias together.
  [[nodiscard]] double u_radius_mm(bool geometric) const {
    return (geometric ? geometric_ : algebraic_).rms(0);
  }
  [[nodiscard]] double u_direction_rad(bool geometric) const {
    return (geometric ? geometric_ : algebraic_).rms(1);
  }

 private:
  struct Errors {
    double squares[2] = {0, 0}, n = 0;
    void add(const Circle& circle, double phase, const Vector2d& truth) {
      squares[0] += std::pow(circle.radius - truth.norm(), 2);
      squares[1] += std::pow(wrap_angle(phase - std::atan2(truth.y(), truth.x())), 2);
      ++n;
    }
    [[nodiscard]] double rms(int which) const { return n > 0 ? std::sqrt(squares[which] / n) : 0; }
  };

  /// The joint fit's six parameters have taken part of the deviations between captures, each of which gives
  /// two distances. Nothing is left to imitate where they have taken all.
  static void widen(std::map<std::size_t, std::vector<Vector2d>>& of_capture) {
    const double distances = 2 * static_cast<double>(of_capture.size());
    if (distances <= 6) return of_capture.clear();
    const double by = std::sqrt(distances / (distances - 6));
    for (auto& [capture, deviations] : of_capture) {
      Vector2d mean = Vector2d::Zero();
      for (const Vector2d& deviation : deviations) mean += deviation / static_cast<double>(deviations.size());
      for (Vector2d& deviation : deviations) deviation += (by - 1) * mean;
    }
  }

  Vector2d truth_;
  Errors geometric_, algebraic_;
};

void add_circles(const std::string& way, const Positions& positions, WallFit& fit) {
  WallCircle geometric{way + ", geometric circle", std::nullopt, {}, {}, positions.at.size(), 0};
  const auto found = circles_through(positions);
  if (!found) {
    fit.ways.push_back(geometric);
    return;
  }
  const Imitations imitations(positions, fit);
  const auto complete = [&](WallCircle& to, const CircleFit& circle, bool is_geometric) {
    to.circle = circle;
    to.inliers = found->inliers.size();
    to.radius_mm = {circle.circle.radius, imitations.u_radius_mm(is_geometric)};
    to.direction_rad = {phase_of(circle.circle, positions, found->inliers),
                        imitations.u_direction_rad(is_geometric)};
  };
  WallCircle algebraic = geometric;
  algebraic.way = way + ", algebraic circle";
  complete(geometric, found->geometric, true);
  complete(algebraic, found->algebraic, false);
  fit.ways.push_back(geometric);
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
