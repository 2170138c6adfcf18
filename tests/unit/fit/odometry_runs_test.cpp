// SPDX-License-Identifier: MIT
#include "fit/motion/odometry_runs.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "fit/motion/wheel_time.hpp"

namespace odometry_runs_test {
namespace {

using fit::Pose2;
using fit::WheelSample;

constexpr double step_s = 0.05;

/// How a robot was really moved and watched in one run.
struct Run {
  double seconds = 20;
  double wheels_late_s = 0;
  double pose_u_mm = 0, pose_u_rad = 0;  ///< Of every watched pose (motion capture).
  double turn_share = 0;                 ///< By which the robot turns less than its wheels say: slip.
  double radius_share = 0;               ///< By which both wheels are larger on this run.
  bool constant = false;                 ///< The same speeds all the time.
  bool always_left = false;
  double clock_s = 0;           ///< By which the watching clock wanders (standard deviation).
  double heading_walk_rad = 0;  ///< Of the heading, in a second of driving.
};

/// The robot that is sought; rolled in steps of a millisecond, without any formula of the product.
struct Truth {
  double first = 42, second = 41.8, base = 201;
  Pose2 lidar{-5, 3, 0.02};
  bool tricycle = false;

  /// What its wheels do at a time: rad/s and rad/s, or rad/s and rad.
  [[nodiscard]] static Eigen::Vector2d wheels(const Run& run, double t, bool steered) {
    if (run.always_left) return {4 + std::sin(0.9 * t), 6 + 2 * std::cos(1.3 * t)};
    if (run.constant) return steered ? Eigen::Vector2d(6, 0.2) : Eigen::Vector2d(4, 5);
    if (steered) return {5 + 2 * std::sin(0.7 * t), 0.6 * std::sin(1.1 * t)};
    return {4 + 3 * std::sin(0.9 * t), 4 + 3 * std::cos(1.3 * t)};
  }

  [[nodiscard]] std::vector<WheelSample> drive(const Run& run, std::size_t number, unsigned seed) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> gauss;
    const int steps = static_cast<int>(run.seconds / step_s);
    std::vector<Pose2> path, poses;
    double x = 0, y = 0, heading = 0;
    const double more = 1 + run.radius_share;
    for (int k = 0; k <= steps; ++k) {
      if (run.heading_walk_rad > 0) heading += run.heading_walk_rad * std::sqrt(step_s) * gauss(random);
      for (int ms = 0; ms < 50; ++ms) {
        const double c = std::cos(heading), s = std::sin(heading);
        path.push_back({x + c * lidar.x_mm - s * lidar.y_mm, y + s * lidar.x_mm + c * lidar.y_mm,
                        heading + lidar.heading_rad});
        const Eigen::Vector2d w = wheels(run, step_s * k + 1e-3 * ms, tricycle);
        const double along = tricycle ? more * first * w[0] * std::cos(w[1] + second)
                                      : more * 0.5 * (first * w[0] + second * w[1]);
        const double turn = tricycle ? more * first * w[0] * std::sin(w[1] + second) / base
                                     : more * (second * w[1] - first * w[0]) / base;
        heading += 5e-4 * turn * (1 - run.turn_share);
        x += 1e-3 * along * std::cos(heading), y += 1e-3 * along * std::sin(heading);
        heading += 5e-4 * turn * (1 - run.turn_share);
      }
    }
    // The clock's error is drawn anew every three seconds, and slides from one to the next.
    double from_s = run.clock_s * gauss(random), to_s = run.clock_s * gauss(random);
    for (int k = 0; k <= steps; ++k) {
      if (k % 60 == 0) from_s = to_s, to_s = run.clock_s * gauss(random);
      const double late_s = from_s + (to_s - from_s) * (k % 60) / 60;
      const long at = std::lround(1000 * (step_s * k + late_s));
      const Pose2& seen = path[static_cast<std::size_t>(std::clamp(at, 0L, long(path.size()) - 1))];
      poses.push_back({seen.x_mm + run.pose_u_mm * gauss(random), seen.y_mm + run.pose_u_mm * gauss(random),
                       seen.heading_rad + run.pose_u_rad * gauss(random)});
    }
    std::vector<WheelSample> out;
    for (int k = 0; k < steps; ++k) {
      WheelSample sample;
      sample.begin_s = step_s * k;
      sample.interval_s = step_s;
      sample.run = number;
      sample.match = poses[static_cast<std::size_t>(k)].inverse() * poses[static_cast<std::size_t>(k) + 1];
      Eigen::Vector2d sum = Eigen::Vector2d::Zero();
      for (int ms = 0; ms < 50; ++ms)
        sum += wheels(run, sample.begin_s + 1e-3 * (ms + 0.5) - run.wheels_late_s, tricycle) / 50;
      if (tricycle) {
        sample.left_rad_s = sum[0];
        sample.pieces = {{sum[0] * step_s, sum[1]}};
      } else {
        sample.left_rad_s = sum[0], sample.right_rad_s = sum[1];
      }
      out.push_back(sample);
    }
    return out;
  }
};

std::vector<WheelSample> all_of(const Truth& truth, const std::vector<Run>& runs, unsigned seed) {
  std::vector<WheelSample> all;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const auto more = truth.drive(runs[i], i, 100 * seed + static_cast<unsigned>(i));
    all.insert(all.end(), more.begin(), more.end());
  }
  return all;
}

double error_in_u(const fit::RunsFit& fit, int i, double truth) {
  return (fit.odometry.robot.vector()[i] - truth) / std::sqrt(fit.odometry.covariance(i, i));
}

fit::RunsOptions timed() {
  fit::RunsOptions options;
  options.timed = true;
  return options;
}

}  // namespace

TEST_CASE("poses with noise of their own tell much more by the whole way than sample by sample") {
  Run run;
  run.pose_u_mm = 0.5, run.pose_u_rad = 0.003;
  const Truth truth;
  const auto samples = all_of(truth, {run, run, run}, 1);
  const auto fit = fit::fit_runs(samples, timed());
  for (std::size_t c = 0; c < 3; ++c)
    CHECK(std::sqrt(fit.noise.of[c].pose) == Approx(c == 2 ? run.pose_u_rad : run.pose_u_mm).epsilon(0.1));
  const auto alone = fit::fit_odometry(samples);
  CHECK(fit.odometry.covariance(2, 2) < 0.25 * alone.covariance(2, 2));
  for (int i = 0; i < 3; ++i) CHECK(std::abs(error_in_u(fit, i, i == 0 ? 42 : i == 1 ? 41.8 : 201)) < 3);
}

TEST_CASE("runs that differ make the uncertainty as large as they differ") {
  const Truth truth;
  int covered = 0;
  const int seeds = 20;
  for (int seed = 1; seed <= seeds; ++seed) {
    std::mt19937 random(static_cast<unsigned>(seed));
    std::normal_distribution<double> gauss(0, 0.002);
    std::vector<Run> runs(6);
    for (Run& run : runs) {
      run.seconds = 8, run.pose_u_mm = 0.3, run.pose_u_rad = 0.002;
      run.radius_share = gauss(random);
    }
    auto options = timed();
    options.known_offset_s = 0;
    const auto fit = fit::fit_runs(all_of(truth, runs, static_cast<unsigned>(seed)), options);
    covered += std::abs(error_in_u(fit, 0, 42)) < 2;
  }
  CHECK(covered >= 17);  // 95 % of 20, less two standard deviations
}

TEST_CASE("intervals hold where the clock wanders, slip adds up and poses are noisy") {
  const Truth truth;
  int covered = 0;
  const int seeds = 12;
  for (int seed = 1; seed <= seeds; ++seed) {
    std::vector<Run> runs(5);
    for (Run& run : runs) {
      run.seconds = 12, run.pose_u_mm = 0.3, run.pose_u_rad = 0.003;
      run.clock_s = 0.03, run.heading_walk_rad = 0.003;
    }
    auto options = timed();
    options.known_offset_s = 0;
    const auto fit = fit::fit_runs(all_of(truth, runs, 100 + static_cast<unsigned>(seed)), options);
    CHECK(std::sqrt(fit.noise.time) == Approx(0.03).epsilon(0.4));
    for (int i = 0; i < 3; ++i)
      covered += std::abs(error_in_u(fit, i, i == 0 ? 42 : i == 1 ? 41.8 : 201)) < 2;
  }
  CAPTURE(covered);
  CHECK(covered >= 30);  // 95 % of 36, less three standard deviations
}

TEST_CASE("a motion capture that jumps now and then does not spoil the fit") {
  const Truth truth;
  std::vector<Run> runs(4);
  for (Run& run : runs) run.pose_u_mm = 0.3, run.pose_u_rad = 0.003;
  auto samples = all_of(truth, runs, 9);
  auto options = timed();
  options.known_offset_s = 0;
  const auto clean = fit::fit_runs(samples, options);
  // One pose in a hundred is 30 mm and 6 deg off: what one sample has too much, the next has too little.
  for (std::size_t k = 50; k + 1 < samples.size(); k += 100) {
    const Pose2 jump{20, -22, 0.1};
    samples[k].match = samples[k].match * jump;
    samples[k + 1].match = jump.inverse() * samples[k + 1].match;
  }
  const auto spoilt = fit::fit_runs(samples, options);
  for (int i = 0; i < 3; ++i) {
    CAPTURE(i, error_in_u(spoilt, i, i == 0 ? 42 : i == 1 ? 41.8 : 201));
    CHECK(std::abs(error_in_u(spoilt, i, i == 0 ? 42 : i == 1 ? 41.8 : 201)) < 3);
    CHECK(spoilt.odometry.covariance(i, i) < 9 * clean.odometry.covariance(i, i));
  }
}

TEST_CASE("a run that slipped is left out, and named") {
  std::vector<Run> runs(6);
  for (Run& run : runs) run.pose_u_mm = 0.3, run.pose_u_rad = 0.002, run.seconds = 10;
  runs[4].turn_share = 0.15;
  const Truth truth;
  const auto fit = fit::fit_runs(all_of(truth, runs, 2), timed());
  for (const fit::RunVerdict& run : fit.runs) {
    CAPTURE(run.run, run.misfit);
    CHECK(run.left_out == (run.run == 4));
  }
  CHECK(std::abs(error_in_u(fit, 2, 201)) < 3);
}

TEST_CASE("a run of three samples beside a long one makes three groups, and none is empty") {
  std::vector<Run> runs(2);
  for (Run& run : runs) run.pose_u_mm = 0.3, run.pose_u_rad = 0.002;
  runs[1].seconds = 3 * step_s;
  auto options = timed();
  options.known_offset_s = 0;  // a shift would leave out the sample at the end
  const auto fit = fit::fit_runs(all_of(Truth{}, runs, 12), options);
  CHECK(fit.groups == 9);
  for (const fit::RunVerdict& group : fit.runs) {
    CHECK(group.samples > 0);
    CHECK(group.run < 2);
    CHECK(group.segments == (group.run == 0 ? 6 : 3));
  }
}

TEST_CASE("the clocks' offset is found for samples too, however large, and each run's own") {
  const double late = GENERATE(-0.43, 0.95);
  std::vector<Run> runs(3);
  for (Run& run : runs) run.pose_u_mm = 0.3, run.pose_u_rad = 0.002, run.wheels_late_s = late;
  runs[1].wheels_late_s = late + 0.06;
  const Truth truth;
  const auto fit = fit::fit_runs(all_of(truth, runs, 3), timed());
  CHECK(fit.offset.determined);
  CHECK(fit.run_offsets_s.at(0) == Approx(late).margin(0.01));
  CHECK(fit.run_offsets_s.at(1) == Approx(late + 0.06).margin(0.01));
  CHECK(std::abs(error_in_u(fit, 2, 201)) < 3);
}

TEST_CASE(
    "an offset that the motion does not show, or that lies beyond the search, is not passed off as found") {
  std::vector<Run> runs(3);
  for (Run& run : runs) run.pose_u_mm = 0.3, run.pose_u_rad = 0.002, run.constant = true;
  const Truth truth;
  const auto constant = fit::fit_runs(all_of(truth, runs, 4), timed());
  CHECK_FALSE(constant.offset.determined);
  for (Run& run : runs) run.constant = false, run.wheels_late_s = 7, run.seconds = 12;
  const auto beyond = fit::fit_runs(all_of(truth, runs, 5), timed());
  CHECK_FALSE(beyond.offset.determined);
}

TEST_CASE("motion to one side is enough where its curves differ, and one circle is declined") {
  std::vector<Run> runs(3);
  for (Run& run : runs) run.pose_u_mm = 0.3, run.pose_u_rad = 0.003, run.always_left = true;
  const Truth truth;
  const auto left = fit::fit_runs(all_of(truth, runs, 10), timed());
  CHECK(left.odometry.undetermined.empty());
  const double expected[6] = {42, 41.8, 201, -5, 3, 0.02};
  for (int i = 0; i < 6; ++i) CHECK(std::abs(error_in_u(left, i, expected[i])) < 3);
  for (Run& run : runs) run.always_left = false, run.constant = true;
  const auto circle = fit::fit_runs(all_of(truth, runs, 11), timed());
  REQUIRE(circle.odometry.undetermined.size() == 1);
  CHECK_THAT(circle.odometry.undetermined.front(), Catch::Contains("straight stretches"));
  CHECK(std::ranges::none_of(circle.odometry.determined, [](bool known) { return known; }));
}

TEST_CASE("a tricycle's wheel, wheelbase and steering zero are found") {
  Truth truth;
  truth.tricycle = true;
  truth.first = 61, truth.second = -0.021, truth.base = 155;
  std::vector<Run> runs(4);
  for (Run& run : runs) run.pose_u_mm = 0.3, run.pose_u_rad = 0.002;
  auto options = timed();
  options.fit.steering = fit::find_steering("tricycle");
  REQUIRE(options.fit.steering);
  const auto fit = fit::fit_runs(all_of(truth, runs, 6), options);
  CHECK(fit.odometry.undetermined.empty());
  const double expected[6] = {61, -0.021, 155, -5, 3, 0.02};
  const double enough[6] = {0.2, 0.003, 1, 1, 1, 0.003};
  for (int i = 0; i < 6; ++i) {
    CAPTURE(i, fit.odometry.robot.vector()[i], std::sqrt(fit.odometry.covariance(i, i)));
    CHECK(std::abs(error_in_u(fit, i, expected[i])) < 3);
    CHECK(std::sqrt(fit.odometry.covariance(i, i)) < enough[i]);
  }
  // Straight ahead alone tells nothing of the base.
  auto straight = all_of(truth, runs, 7);
  for (WheelSample& sample : straight) {
    sample.pieces = {{0.3, 0.021}};
    sample.match = {61 * 0.3, 0, 0};
  }
  const auto ahead = fit::fit_odometry(straight, options.fit);
  REQUIRE(ahead.undetermined.size() == 1);
  CHECK_THAT(ahead.undetermined.front(), Catch::Contains("only straight"));
}

}  // namespace odometry_runs_test
