// SPDX-License-Identifier: MIT
#include "rig/runner/target_detection.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "fit/numeric/median.hpp"
#include "rig/procedure/procedure_value.hpp"

namespace rig {
namespace {

constexpr double data_sheet_error_mm = 40;  // UST-10LX, 0.06 m to 10 m.
constexpr double least_share = 0.5;         // Of the beams on a target that must see it.
// Range errors that vary over a surface turn it by less than this.
constexpr double turn_of_range_errors_rad = 1 * fit::rad_per_deg;
constexpr std::size_t beams_of_a_direction = 8;

double across(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

Eigen::Vector2d origin_of(const fit::Bench& bench, double stage_rad) {
  const fit::Mount& mount = bench.lidar.mount;
  return Eigen::Rotation2Dd(stage_rad) * Eigen::Vector2d(mount.x_mm.value, mount.y_mm.value);
}

Eigen::Vector2d ray_of(const fit::Bench& bench, double stage_rad, std::size_t step) {
  const double direction =
      stage_rad + bench.lidar.mount.yaw_rad.value + bench.lidar.beam_angle(static_cast<double>(step));
  return {std::cos(direction), std::sin(direction)};
}

/// How far a range on the target moves when the mount's yaw is wrong by its standard uncertainty.
double u_of_yaw_mm(fit::Bench bench, const fit::Target& target, double stage_rad,
                   const std::vector<double>& expected) {
  bench.lidar.mount.yaw_rad.value += bench.lidar.mount.yaw_rad.u;
  const auto turned = expected_ranges_mm(bench, target, stage_rad);
  std::vector<double> moved;
  for (std::size_t k = 0; k < expected.size(); ++k)
    if (std::isfinite(expected[k]) && std::isfinite(turned[k]))
      moved.push_back(std::abs(turned[k] - expected[k]));
  return fit::median_of(std::move(moved));
}

double allowed_for(const fit::Bench& bench, const fit::Target& target, double stage_rad,
                   const std::vector<double>& expected) {
  const fit::Mount& mount = bench.lidar.mount;
  const double u_mm = std::hypot(target.u_mm, std::max(mount.x_mm.u, mount.y_mm.u),
                                 u_of_yaw_mm(bench, target, stage_rad, expected));
  return largest_range_error_mm(bench) + 3 * u_mm;
}

/// The direction of a line through points, with its standard uncertainty from their scatter.
struct Direction {
  double rad = 0, u_rad = 0;
};

Direction direction_of(const std::vector<Eigen::Vector2d>& points) {
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (const auto& point : points) middle += point / static_cast<double>(points.size());
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  for (const auto& point : points) spread += (point - middle) * (point - middle).transpose();
  const double rad = 0.5 * std::atan2(2 * spread(0, 1), spread(0, 0) - spread(1, 1));
  const Eigen::Vector2d along(std::cos(rad), std::sin(rad));
  const double lengths = along.dot(spread * along), rest = spread.trace() - lengths;
  const double variance = std::max(0.0, rest) / static_cast<double>(points.size() - 2);
  return {rad, lengths > 0 ? std::sqrt(variance / lengths) : std::numeric_limits<double>::infinity()};
}

/// How far a line through the points turns when every range is wrong by `bias_mm`.
double turn_of_bias_rad(std::vector<Eigen::Vector2d> points, double bias_mm, double rad) {
  for (Eigen::Vector2d& point : points) point += bias_mm * point.normalized();
  return std::remainder(direction_of(points).rad - rad, fit::pi);
}

std::string in_mm(double mm) { return rounded_text(mm, std::abs(mm) < 10 ? 1 : 0) + " mm"; }

/// "it is seen 390 mm farther away than asked, at 1790 mm instead of 1400 mm (46 mm allowed)".
std::string words_of_distance(const TargetDetection& detection, double asked_mm) {
  return "it is seen " + in_mm(std::abs(detection.to_go_mm)) +
         (detection.to_go_mm > 0 ? " farther away" : " nearer") + " than asked, at " +
         in_mm(detection.seen_mm) + " from the stage's axis instead of " + in_mm(asked_mm) + " (" +
         in_mm(detection.allowed_mm) + " allowed)";
}

/// Beams on the target and what they see.
struct BeamsOnTarget {
  std::size_t beams = 0, near = 0;
  std::vector<double> off_mm, intensity;  ///< Along the normal; one a beam with an echo.
  std::vector<Eigen::Vector2d> points;    ///< Those within what is allowed, seen from the lidar.
};

BeamsOnTarget beams_on(const fit::Bench& bench, const fit::Target& target,
                       const std::vector<fit::Target>& others, double stage_rad, const BeamMedians& seen,
                       const std::vector<double>& expected, double allowed_mm) {
  std::vector<double> nearest(expected.size(), std::numeric_limits<double>::infinity());
  for (const fit::Target& other : others) {
    if (other.name == target.name) continue;
    const auto ranges = expected_ranges_mm(bench, other, stage_rad);
    for (std::size_t k = 0; k < nearest.size(); ++k)
      if (ranges[k] < nearest[k]) nearest[k] = ranges[k];
  }
  BeamsOnTarget on;
  for (std::size_t k = 0; k < expected.size(); ++k) {
    if (!std::isfinite(expected[k]) || nearest[k] < expected[k]) continue;
    ++on.beams;
    if (k >= seen.range_mm.size() || !std::isfinite(seen.range_mm[k])) continue;
    const Eigen::Vector2d ray = ray_of(bench, stage_rad, k);
    const double off_mm = seen.range_mm[k] - expected[k];
    on.off_mm.push_back(off_mm * ray.dot(target.outward_normal()));
    if (k < seen.intensity.size() && std::isfinite(seen.intensity[k]))
      on.intensity.push_back(seen.intensity[k]);
    if (std::abs(off_mm) > allowed_mm) continue;
    ++on.near;
    on.points.emplace_back(seen.range_mm[k] * ray);
  }
  return on;
}

}  // namespace

std::vector<double> expected_ranges_mm(const fit::Bench& bench, const fit::Target& target, double stage_rad) {
  const Eigen::Vector2d along = target.to_mm - target.from_mm,
                        to_wall = target.from_mm - origin_of(bench, stage_rad);
  const auto steps = static_cast<std::size_t>(bench.lidar.steps);
  std::vector<double> ranges(steps, std::numeric_limits<double>::quiet_NaN());
  for (auto step = static_cast<std::size_t>(std::max(0, bench.lidar.first_step)); step < steps; ++step) {
    const Eigen::Vector2d ray = ray_of(bench, stage_rad, step);
    const double facing = across(ray, along);
    if (std::abs(facing) < 1e-9) continue;
    const double range = across(to_wall, along) / facing, place = across(to_wall, ray) / facing;
    // The ends are left out: a mount known to some millimetres moves the edges.
    if (range > 0 && place > 0.1 && place < 0.9) ranges[step] = range;
  }
  return ranges;
}

fit::Target shifted(fit::Target target, double shift_mm) {
  const Eigen::Vector2d way = shift_mm * target.outward_normal();
  target.from_mm += way;
  target.to_mm += way;
  return target;
}

double distance_mm(const fit::Target& target) { return target.from_mm.dot(target.outward_normal()); }

double largest_range_error_mm(const fit::Bench& bench) {
  const auto stated = bench.document.section("lidar").value("largest_error_mm", nlohmann::json());
  return stated.is_number() ? stated.get<double>() : data_sheet_error_mm;
}

TargetDetection detect_target(const fit::Bench& bench, const fit::Target& target,
                              const std::vector<fit::Target>& others, double stage_rad,
                              const BeamMedians& seen, std::optional<double> tolerance_mm) {
  const auto expected = expected_ranges_mm(bench, target, stage_rad);
  TargetDetection detection;
  detection.allowed_mm = tolerance_mm ? *tolerance_mm : allowed_for(bench, target, stage_rad, expected);
  BeamsOnTarget on = beams_on(bench, target, others, stage_rad, seen, expected, detection.allowed_mm);
  if (on.beams == 0) {
    detection.words = "it is not in the field of view at this stage angle";
    return detection;
  }
  detection.intensity = on.intensity.empty() ? std::numeric_limits<double>::quiet_NaN()
                                             : fit::median_of(std::span(on.intensity));
  if (static_cast<double>(on.off_mm.size()) < least_share * static_cast<double>(on.beams)) {
    detection.outcome = TargetDetection::Outcome::undetected;
    detection.words = "nothing is seen there: no echo from " + std::to_string(on.beams - on.off_mm.size()) +
                      " of its " + std::to_string(on.beams) + " beams";
    return detection;
  }
  const double asked_mm = distance_mm(target);
  detection.to_go_mm = fit::median_of(std::span(on.off_mm));
  detection.seen_mm = asked_mm + detection.to_go_mm;
  detection.outcome = TargetDetection::Outcome::misplaced;
  if (static_cast<double>(on.near) < least_share * static_cast<double>(on.off_mm.size())) {
    detection.words =
        std::abs(detection.to_go_mm) > detection.allowed_mm
            ? words_of_distance(detection, asked_mm)
            : "it is seen by " + std::to_string(on.near) + " of its " + std::to_string(on.beams) +
                  " beams only: it is turned, moved sideways, or something stands in front of it";
    return detection;
  }
  if (on.points.size() >= beams_of_a_direction) {
    const Direction seen_line = direction_of(on.points);
    const Eigen::Vector2d along = target.to_mm - target.from_mm;
    const double asked_rad = std::atan2(along.y(), along.x());
    // A line has no sense: half a turn is the same direction.
    const double off_rad = std::remainder(seen_line.rad - asked_rad, fit::pi);
    const double allowed_rad =
        turn_of_range_errors_rad +
        std::abs(turn_of_bias_rad(on.points, largest_range_error_mm(bench), seen_line.rad)) +
        3 * std::hypot(target.u_rad, bench.lidar.mount.yaw_rad.u, seen_line.u_rad);
    if (!tolerance_mm && std::abs(off_rad) > allowed_rad) {
      detection.words = "it is seen turned by " + rounded_text(off_rad * fit::deg_per_rad, 1) + " deg (" +
                        rounded_text(allowed_rad * fit::deg_per_rad, 1) + " deg allowed)";
      return detection;
    }
  }
  detection.outcome = TargetDetection::Outcome::in_place;
  detection.words = "it is seen at " + in_mm(detection.seen_mm) + " from the stage's axis, " +
                    in_mm(std::abs(detection.to_go_mm)) + " off (" + in_mm(detection.allowed_mm) +
                    " allowed)";
  return detection;
}

}  // namespace rig
