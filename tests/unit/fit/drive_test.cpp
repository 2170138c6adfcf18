// SPDX-License-Identifier: MIT
#include "fit/motion/drive.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <random>

#include "tests/support/moving_room.hpp"
#include "tests/support/rounds.hpp"

namespace drive_test {
namespace {

using room::deg;

/// A robot driving curves there and back in a room, and resting now and then; its lidar turns ten times a
/// second.
struct Robot {
  double left_radius = 32.6, right_radius = 33.0, separation = 168;
  room::Pose lidar{-42, 6, 1.5 * deg};
  double wheels_late_s = 0.04, sigma_mm = 10, seconds = 60;
  bool beams_backwards = false;  ///< The driver lists them against their order in time.
  bool left_circle = false;      ///< Nothing but one circle.
  /// From here on the left wheel turns a third more than the robot moves, for five seconds; 0: never.
  double slips_at_s = 0;
  double stamps_late_s = 0;  ///< Scans and wheels are stamped up to so much too late, by chance.

  struct State {
    room::Pose at;
    double left = 0, right = 0;
  };
  /// The state at every millisecond.
  [[nodiscard]] std::vector<State> drive() const {
    std::vector<State> states(1);
    for (int ms = 1; ms < 1000 * (seconds + 1); ++ms) {
      const double t = 1e-3 * ms;
      const bool rests = std::fmod(t, 20) > 16;
      const double v = left_circle ? 150
                       : rests     ? 0
                                   : 170 * std::cos(0.35 * t),
                   w = left_circle ? 0.4
                       : rests     ? 0
                                   : 0.45 * std::sin(0.9 * t) + 0.1 * std::cos(0.23 * t);
      const double slip = slips_at_s > 0 && t > slips_at_s && t < slips_at_s + 5 ? 1.33 : 1;
      State next = states.back();
      next.at.heading += 5e-4 * w;
      next.at.x += 1e-3 * v * std::cos(next.at.heading);
      next.at.y += 1e-3 * v * std::sin(next.at.heading);
      next.at.heading += 5e-4 * w;
      next.left += 1e-3 * slip * (v - 0.5 * w * separation) / left_radius;
      next.right += 1e-3 * (v + 0.5 * w * separation) / right_radius;
      states.push_back(next);
    }
    return states;
  }
};

class Drive : public fit::Recording {
 public:
  Drive(const Robot& robot, unsigned seed)
      : bench_(fit::parse_bench(
            R"({"schema": "bench/1", "lidar": {"model": "slow", "steps": 240, "front_step": 120,
          "step_deg": 1.5, "scan_hz": 10, "mount": {"x_mm": -32, "y_mm": 0, "yaw_deg": 0}}})")) {
    const auto states = robot.drive();
    const auto walls = room::furnished();
    std::mt19937 random(seed);
    std::normal_distribution<double> gauss(0, std::max(1e-12, robot.sigma_mm));
    std::uniform_real_distribution<double> late(0, std::max(1e-12, robot.stamps_late_s));
    fit::CaptureInfo capture;
    capture.last_step = 239;
    captures_.push_back(capture);
    for (double t = 0.2; t < robot.seconds; t += 0.1) {
      std::vector<std::uint16_t> ranges;
      for (int k = 0; k < 240; ++k) {
        const int passed = robot.beams_backwards ? 239 - k : k;
        const auto& at = states[static_cast<std::size_t>(1000 * (t + 0.1 * passed / 240))].at;
        const room::Point origin = room::placed(at, robot.lidar.x, robot.lidar.y);
        const double mm = room::range_to(
            walls, {origin.x, origin.y, at.heading + robot.lidar.heading + (k - 120) * 1.5 * deg});
        ranges.push_back(mm < 9000 ? static_cast<std::uint16_t>(std::lround(mm + gauss(random))) : 0);
      }
      times_.push_back(std::llround(1e6 * (t + late(random))));
      scans_.push_back(ranges);
    }
    for (double t = 0; t < robot.seconds; t += 0.05) {
      const auto& state = states[static_cast<std::size_t>(1000 * t)];
      fit::TrackPose pose;
      pose.host_us = std::llround(1e6 * (t + robot.wheels_late_s + 0.4 * late(random)));
      pose.wheel_left_rad = state.left;
      pose.wheel_right_rad = state.right;
      track_.push_back(pose);
    }
  }
  const fit::Bench& bench() const override { return bench_; }
  const std::vector<fit::CaptureInfo>& captures() const override { return captures_; }
  const std::vector<fit::TrackPose>& track() const override { return track_; }
  void for_each_scan(std::size_t, const std::function<void(const fit::ScanView&)>& visit) const override {
    for (std::size_t i = 0; i < scans_.size(); ++i)
      visit({static_cast<std::int64_t>(i), times_[i] / 1000, times_[i], scans_[i], {}, {}});
  }
  void forget_wheels() { track_.clear(); }

 private:
  fit::Bench bench_;
  std::vector<fit::CaptureInfo> captures_;
  std::vector<fit::TrackPose> track_;
  std::vector<std::int64_t> times_;
  std::vector<std::vector<std::uint16_t>> scans_;
};

fit::DriveOptions from_nominal() {
  fit::DriveOptions options;
  options.guess.left_radius_mm = options.guess.right_radius_mm = 33;
  options.guess.separation_mm = 160;
  options.fit.refine = true;
  options.range_scale = 0;  // The simulated lidar's scale is right.
  return options;
}

const double* truth_of(const Robot& robot) {
  static double values[6];
  const double all[6] = {robot.left_radius, robot.right_radius, robot.separation,
                         robot.lidar.x,     robot.lidar.y,      robot.lidar.heading};
  std::copy(all, all + 6, values);
  return values;
}

/// Each value within so many of its standard uncertainties.
void check_within(const fit::DriveFit& fit, const Robot& robot, double times) {
  for (int i = 0; i < 6; ++i) {
    const double u = std::sqrt(fit.odometry.covariance(i, i)),
                 e = fit.odometry.robot.vector()[i] - truth_of(robot)[i];
    CAPTURE(i, e, u);
    CHECK(std::abs(e) < times * u);
  }
}

}  // namespace

TEST_CASE("a drive past walls calibrates wheels and lidar pose", "[rounds]") {
  const Robot truth;
  const double* expected = truth_of(truth);
  for (const unsigned seed : some_of<unsigned>({1, 2})) {
    const auto fit = fit::fit_drive(Drive(truth, seed), from_nominal());
    CHECK(fit.odometry.undetermined.empty());
    for (int i = 0; i < 6; ++i) {
      const double u = std::sqrt(fit.odometry.covariance(i, i)),
                   e = fit.odometry.robot.vector()[i] - expected[i];
      CAPTURE(seed, i, e, u, fit.jackknife_u[i]);
      CHECK(std::abs(e) < 3 * u);
      const double enough[6] = {0.3, 0.3, 2, 5, 5, 0.5 * deg};
      CHECK(u < enough[i]);
      if (std::getenv("SHOW")) WARN(i << ": " << e << " +/- " << u << " jackknife " << fit.jackknife_u[i]);
    }
    CHECK(fit.offset.determined);
    CHECK(fit.offset.offset_s.value == Approx(0.04).margin(0.01));
    CHECK_FALSE(fit.even_scans);
    CHECK_FALSE(fit.timing.timing.reversed);
    CHECK(fit.still_s == Approx(12).margin(2));
    CHECK(fit.still_noise[0] < 5);
  }
}

TEST_CASE("wheels a second late and beams listed against their order are both found") {
  Robot robot;
  robot.wheels_late_s = 0.95;
  robot.beams_backwards = true;
  const auto fit = fit::fit_drive(Drive(robot, 4), from_nominal());
  CHECK(fit.odometry.undetermined.empty());
  CHECK(fit.offset.determined);
  CHECK(fit.offset.offset_s.value == Approx(0.95).margin(0.01));
  CHECK(fit.timing.timing.reversed);
  check_within(fit, robot, 3);
}

TEST_CASE("an offset beyond what the drive can be searched for is not passed off as found") {
  Robot robot;
  robot.wheels_late_s = 14;
  const auto fit = fit::fit_drive(Drive(robot, 5), from_nominal());
  CHECK_FALSE(fit.offset.determined);
}

TEST_CASE("a segment with slip is left out of a drive") {
  Robot robot;
  robot.slips_at_s = 28;
  const auto fit = fit::fit_drive(Drive(robot, 6), from_nominal());
  CHECK(std::ranges::any_of(fit.segments, &fit::RunVerdict::left_out));
  check_within(fit, robot, 3);
}

TEST_CASE("one circle alone does not pass for a calibration") {
  Robot robot;
  robot.left_circle = true;
  const auto fit = fit::fit_drive(Drive(robot, 7), from_nominal());
  if (fit.odometry.undetermined.empty())
    check_within(fit, robot, 3);
  else
    CHECK_THAT(fit.odometry.undetermined.front(), Catch::Contains("do not determine"));
}

TEST_CASE("stamps that come late by chance are made even") {
  Robot robot;
  robot.stamps_late_s = 0.12;
  const auto fit = fit::fit_drive(Drive(robot, 8), from_nominal());
  CHECK(fit.even_scans);
  check_within(fit, robot, 3);
}

TEST_CASE("a drive without wheels or without motion is refused in words") {
  const Robot truth;
  Robot resting = truth;
  resting.seconds = 10;
  Drive drive(resting, 3);
  drive.forget_wheels();
  CHECK_THROWS_WITH(fit::fit_drive(drive, from_nominal()), Catch::Contains("no wheel angles"));
  CHECK_THROWS_WITH(fit::fit_drive(Drive(resting, 3)), Catch::Contains("nominal wheels"));
}

}  // namespace drive_test
