// SPDX-License-Identifier: MIT
#include "fit/motion/odometry.hpp"

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <random>

namespace odometry_test {
namespace {

using fit::Pose2;
using fit::WheelSample;

const fit::RobotGeometry truth{32.6, 33.2, 158.0, {-31.0, 4.0, 0.05}};

/// How the lidar moves, found without any arc formula: the wheels are rolled in ten thousand small steps.
Pose2 rolled(const fit::RobotGeometry& robot, double interval_s, double left, double right) {
  const int steps = 10'000;
  double x = 0, y = 0, heading = 0;
  for (int i = 0; i < steps; ++i) {
    const double dl = robot.left_radius_mm * left * interval_s / steps;
    const double dr = robot.right_radius_mm * right * interval_s / steps;
    heading += 0.5 * (dr - dl) / robot.separation_mm;
    x += 0.5 * (dl + dr) * std::cos(heading);
    y += 0.5 * (dl + dr) * std::sin(heading);
    heading += 0.5 * (dr - dl) / robot.separation_mm;
  }
  // The lidar's start and end in the world, then the end seen from the start.
  const double cl = std::cos(robot.lidar.heading_rad), sl = std::sin(robot.lidar.heading_rad);
  const double ex = x + std::cos(heading) * robot.lidar.x_mm - std::sin(heading) * robot.lidar.y_mm;
  const double ey = y + std::sin(heading) * robot.lidar.x_mm + std::cos(heading) * robot.lidar.y_mm;
  const double dx = ex - robot.lidar.x_mm, dy = ey - robot.lidar.y_mm;
  return {cl * dx + sl * dy, -sl * dx + cl * dy, heading};
}

struct Wheels {
  double left, right;
};

std::vector<WheelSample> drive(const std::vector<Wheels>& kinds, std::size_t count, unsigned seed,
                               double noise_mm = 1.5, double noise_rad = 0.002) {
  std::mt19937 random(seed);
  std::normal_distribution<double> gauss;
  std::vector<Pose2> exact;
  for (const Wheels& w : kinds) exact.push_back(rolled(truth, 0.5, w.left, w.right));
  std::vector<WheelSample> samples;
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t kind = k % kinds.size();
    Pose2 match = exact[kind];
    match.x_mm += noise_mm * gauss(random);
    match.y_mm += noise_mm * gauss(random);
    match.heading_rad += noise_rad * gauss(random);
    samples.push_back({0.5, kinds[kind].left, kinds[kind].right, match});
  }
  return samples;
}

const std::vector<Wheels> mixed{{6, 6}, {-6, -5.8}, {5, -5}, {-4, 4}, {6, 2}, {2, 6}, {-5, -1}, {0, 0.01}};

constexpr const char* khepera = RIG_SOURCE_DIR "/../shared/real/censi-khepera/";

std::vector<WheelSample> read_tuples(const std::string& path) {
  std::ifstream in(path);
  std::vector<WheelSample> samples;
  nlohmann::json line;
  while (in >> std::ws && !in.eof()) {
    in >> line;
    samples.push_back({line.at("T"),
                       line.at("phi_l"),
                       line.at("phi_r"),
                       {1000 * line.at("sm").at(0).get<double>(), 1000 * line.at("sm").at(1).get<double>(),
                        line.at("sm").at(2)}});
  }
  return samples;
}

}  // namespace

TEST_CASE("without noise the odometry fit returns the robot exactly") {
  const auto fit = fit::fit_odometry(drive(mixed, 400, 1, 0, 0));
  const auto difference = (fit.robot.vector() - truth.vector()).eval();
  CHECK(difference.cwiseAbs().maxCoeff() < 1e-4);
  CHECK(fit.undetermined.empty());
}

TEST_CASE("odometry intervals cover the truth over seeds") {
  const int seeds = 200;
  Eigen::Matrix<double, 6, 1> covered = Eigen::Matrix<double, 6, 1>::Zero();
  for (unsigned seed = 0; seed < seeds; ++seed) {
    fit::OdometryOptions options;
    options.refine = true;
    const auto fit = fit::fit_odometry(drive(mixed, 240, seed), options);
    for (int i = 0; i < 6; ++i)
      covered[i] +=
          std::abs(fit.robot.vector()[i] - truth.vector()[i]) <= 2 * std::sqrt(fit.covariance(i, i));
  }
  for (int i = 0; i < 6; ++i) {
    CAPTURE(i);
    CHECK(covered[i] / seeds > 0.90);
    CHECK(covered[i] / seeds < 0.995);
  }
}

TEST_CASE("samples of a slipping robot are dropped") {
  auto samples = drive(mixed, 800, 3);
  for (std::size_t k = 0; k < samples.size(); k += 40) samples[k].match.heading_rad += 0.3;
  const auto fit = fit::fit_odometry(samples);
  for (std::size_t k = 0; k < samples.size(); k += 40) CHECK_FALSE(fit.used[k]);
  for (int i = 0; i < 6; ++i)
    CHECK(std::abs(fit.robot.vector()[i] - truth.vector()[i]) < 4 * std::sqrt(fit.covariance(i, i)));
}

TEST_CASE("motion that leaves parameters unobservable is reported in words") {
  const auto straight = fit::fit_odometry(drive({{6, 6}, {-5, -5}, {3, 3}}, 300, 4));
  REQUIRE(straight.undetermined.size() == 1);
  CHECK_THAT(straight.undetermined[0], Catch::Contains("only straight"));
  CHECK_THAT(straight.undetermined[0], Catch::Contains("lidar's x"));
  const auto turning = fit::fit_odometry(drive({{5, -5}, {-5, 5}, {3, -3}}, 300, 5));
  REQUIRE(turning.undetermined.size() == 1);
  CHECK_THAT(turning.undetermined[0], Catch::Contains("only turned on the spot"));
  CHECK_THAT(turning.undetermined[0], Catch::Contains("wheel separation"));
  const auto still = fit::fit_odometry(drive({{0, 0}, {0.001, 0}}, 300, 6));
  REQUIRE(still.undetermined.size() == 1);
  CHECK_THAT(still.undetermined[0], Catch::Contains("barely moved"));
}

TEST_CASE("the published calibrations of a Khepera robot are found again") {
  if (!std::filesystem::exists(khepera)) {
    WARN("skipped: the public recordings are not beside the project");
    return;
  }
  for (const std::string name :
       {"l90", "l90_0", "l90_1", "l90_2", "lstraight", "lstraight_0", "lstraight_1", "lstraight_2"}) {
    CAPTURE(name);
    std::ifstream in(khepera + name + "_results.json");
    const auto published = nlohmann::json::parse(in);
    const auto fit = fit::fit_odometry(read_tuples(khepera + name + ".tuple"));
    Eigen::Matrix<double, 6, 1> theirs;
    theirs << 500 * published.at("l_diam").get<double>(), 500 * published.at("r_diam").get<double>(),
        1000 * published.at("axle").get<double>(), 1000 * published.at("l_x").get<double>(),
        1000 * published.at("l_y").get<double>(), published.at("l_theta").get<double>();
    for (int i = 0; i < 6; ++i) {
      const double unit = i < 5 ? 1000 : 1;
      const double u = unit * std::sqrt(published.at("covariance").at(i).at(i).get<double>());
      CAPTURE(i);
      CHECK(std::abs(fit.robot.vector()[i] - theirs[i]) < u);
      // Their noise figure still holds the outliers of all rounds but the first.
      CHECK(std::sqrt(fit.first_round_covariance(i, i)) / u == Approx(1).margin(0.2));
      // Where the first round drops all outliers (lstraight), both figures agree.
      if (name[1] == 's') CHECK(std::sqrt(fit.covariance(i, i)) / u == Approx(1).margin(0.1));
    }
    CHECK(fit.undetermined.empty());
  }
}

}  // namespace odometry_test
