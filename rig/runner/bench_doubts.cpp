// SPDX-License-Identifier: MIT
#include "rig/runner/bench_doubts.hpp"

#include <cmath>

#include "rig/procedure/procedure_plan.hpp"
#include "rig/runner/bench_file.hpp"
#include "rig/runner/target_detection.hpp"

namespace rig {
namespace {

// What is usual is wide: a value beyond it is more likely in another unit than so unusual.
constexpr double usual_nearest_mm = 50, usual_farthest_mm = 60'000, narrowest_mm = 20, widest_mm = 100'000;
constexpr double largest_mount_mm = 1000, largest_u_mm = 300, largest_u_deg = 20;
constexpr double slowest_hz = 1, fastest_hz = 200, whole_turn_deg = 360.5;
constexpr double narrowest_limits_deg = 7, slowest_deg_s = 0.05, fastest_deg_s = 2000;
constexpr double widest_tolerance_deg = 0.5;
constexpr double coarsest_deg = 2, largest_reflectance = 5, worst_error_mm = 500;

std::string mm(double value) { return rounded_text(value, 1) + " mm"; }

class Doubts {
 public:
  void unless(bool usual, const std::string& sentence) {
    if (!usual) found_.push_back(sentence);
  }
  [[nodiscard]] std::vector<std::string> found() && { return std::move(found_); }

 private:
  std::vector<std::string> found_;
};

void of_target(Doubts& doubts, const fit::Target& target) {
  const double away_mm = distance_mm(target), width_mm = (target.to_mm - target.from_mm).norm();
  const double corner_mm = std::max(target.from_mm.norm(), target.to_mm.norm());
  const std::string name = "Target '" + target.name + "' ";
  doubts.unless(corner_mm >= usual_nearest_mm, name + "lies within " + mm(corner_mm) +
                                                   " of the stage's axis: are from_mm and to_mm in metres?");
  doubts.unless(
      away_mm <= usual_farthest_mm,
      name + "stands " + mm(away_mm) + " from the stage's axis, farther than such a lidar measures.");
  doubts.unless(width_mm >= narrowest_mm && width_mm <= widest_mm, name + "is " + mm(width_mm) + " wide.");
  doubts.unless(target.u_mm <= largest_u_mm,
                name + "has u_mm " + to_text(target.u_mm) + ": its position is practically unknown.");
  doubts.unless(target.u_rad * fit::deg_per_rad <= largest_u_deg,
                name + "has u_deg " + rounded_text(target.u_rad * fit::deg_per_rad, 1) +
                    ": its orientation is practically unknown.");
  doubts.unless(target.reflectance.value_or(0) <= largest_reflectance,
                name + "has reflectance " + to_text(target.reflectance.value_or(0)) +
                    ": 1 is white; is it in per cent?");
}

void of_lidar(Doubts& doubts, const fit::Bench& bench) {
  const fit::LidarGeometry& lidar = bench.lidar;
  const double from_axis_mm = std::hypot(lidar.mount.x_mm.value, lidar.mount.y_mm.value);
  doubts.unless(from_axis_mm <= largest_mount_mm,
                "lidar.mount puts the lidar " + mm(from_axis_mm) + " from the stage's axis.");
  doubts.unless(std::max(lidar.mount.x_mm.u, lidar.mount.y_mm.u) <= largest_u_mm,
                "lidar.mount has an uncertainty of " + mm(std::max(lidar.mount.x_mm.u, lidar.mount.y_mm.u)) +
                    ": its position is practically unknown.");
  doubts.unless(lidar.scan_hz >= slowest_hz && lidar.scan_hz <= fastest_hz,
                "lidar.scan_hz is " + to_text(lidar.scan_hz) + " scans a second; 10 to 50 is usual.");
  const double field_deg = (lidar.steps - 1) * lidar.step_rad * fit::deg_per_rad;
  doubts.unless(field_deg <= whole_turn_deg, "lidar.steps and lidar.step_deg make a field of view of " +
                                                 rounded_text(field_deg, 1) + " deg, more than a turn.");
  doubts.unless(largest_range_error_mm(bench) <= worst_error_mm,
                "lidar.largest_error_mm is " + to_text(largest_range_error_mm(bench)) + ": 40 is usual.");
}

void of_stage(Doubts& doubts, const fit::Bench& bench) {
  const StageLimits limits = stage_limits(bench);
  const double span_deg = limits.max_deg - limits.min_deg;
  doubts.unless(
      span_deg >= narrowest_limits_deg,
      "stage.limits_deg leaves the stage " + rounded_text(span_deg, 2) + " deg to turn: is it in radians?");
  doubts.unless(limits.speed_deg_s >= slowest_deg_s && limits.speed_deg_s <= fastest_deg_s,
                "stage.speed_deg_s is " + to_text(limits.speed_deg_s) + ": 5 to 100 is usual.");
  const double resolution_deg = bench.stage_resolution_rad * fit::deg_per_rad;
  doubts.unless(resolution_deg <= coarsest_deg,
                "stage.resolution_deg is " + rounded_text(resolution_deg, 3) + ": 0.001 to 0.1 is usual.");
  const double tolerance_deg = bench_stage_options(bench).tolerance_deg;
  doubts.unless(tolerance_deg <= widest_tolerance_deg,
                "stage.tolerance_deg is " + to_text(tolerance_deg) +
                    ": a stage that loses steps is noticed only beyond that; 0.02 is usual.");
}

}  // namespace

std::vector<std::string> doubts_about(const fit::Bench& bench) {
  Doubts doubts;
  for (const fit::Target& target : bench.targets) of_target(doubts, target);
  of_lidar(doubts, bench);
  of_stage(doubts, bench);
  return std::move(doubts).found();
}

}  // namespace rig
