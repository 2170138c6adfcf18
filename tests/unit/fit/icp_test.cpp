// SPDX-License-Identifier: MIT
#include "fit/motion/icp.hpp"

#include <catch2/catch.hpp>
#include <random>

#include "tests/support/moving_room.hpp"

namespace icp_test {
namespace {

using Eigen::Vector2d;
using fit::Pose2;

std::vector<Vector2d> seen_from(const std::vector<room::Wall>& walls, const room::Pose& at, double sigma_mm,
                                unsigned seed, double farthest_mm = 1e9) {
  std::mt19937 random(seed);
  const auto ranges = room::scan(
      walls, [&](double) { return at; }, 0, sigma_mm, random);
  std::vector<Vector2d> points;
  for (std::size_t k = 0; k < ranges.size(); ++k) {
    const double a = (-135 + 0.25 * static_cast<double>(k)) * room::deg;
    if (ranges[k] > 0 && ranges[k] < farthest_mm)
      points.emplace_back(ranges[k] * std::cos(a), ranges[k] * std::sin(a));
  }
  return points;
}

}  // namespace

TEST_CASE("the closed form returns the motion, never a mirror image") {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> any(-3, 3);
  for (int round = 0; round < 50; ++round) {
    const Pose2 motion{1000 * any(random), 1000 * any(random), any(random)};
    std::vector<Vector2d> from, to;
    for (int i = 0; i < 12; ++i) {
      from.emplace_back(1000 * any(random), 1000 * any(random));
      to.push_back(motion * from.back());
    }
    const Pose2 found = fit::closed_form_motion(from, to);
    CHECK((found.position() - motion.position()).norm() < 1e-6);
    CHECK(std::abs(fit::wrap_angle(found.heading_rad - motion.heading_rad)) < 1e-10);
    for (Vector2d& p : to)
      p.x() = -p.x();  // a mirror image: no motion brings it over, R must stay a rotation
    const Pose2 best = fit::closed_form_motion(from, to);
    double sum = 0;
    for (std::size_t i = 0; i < from.size(); ++i) sum += (best * from[i] - to[i]).squaredNorm();
    for (double turn = -3; turn < 3.1; turn += 0.05) {  // brute force over rotations about the centroids
      double other = 0;
      Vector2d mean_from = Vector2d::Zero(), mean_to = Vector2d::Zero();
      for (std::size_t i = 0; i < from.size(); ++i) mean_from += from[i] / 12, mean_to += to[i] / 12;
      for (std::size_t i = 0; i < from.size(); ++i)
        other += (Pose2{0, 0, turn} * Vector2d(from[i] - mean_from) - (to[i] - mean_to)).squaredNorm();
      CHECK(sum <= other + 1e-6 * other);
    }
  }
}

TEST_CASE("the nearest neighbour is the nearest") {
  std::mt19937 random(8);
  std::uniform_real_distribution<double> any(-1000, 1000);
  std::vector<fit::OrientedPoint> points(500);
  for (auto& p : points) p.at_mm = {any(random), any(random)};
  const fit::PointCloud cloud(points);
  for (int i = 0; i < 200; ++i) {
    const Vector2d at(any(random), any(random));
    double least = 1e18;
    std::size_t within = 0;
    for (const auto& p : points) {
      least = std::min(least, (p.at_mm - at).norm());
      within += (p.at_mm - at).norm() < 200;
    }
    const auto* found = cloud.nearest(at, 5000);
    REQUIRE(found);
    CHECK((found->at_mm - at).norm() == Approx(least));
    CHECK(cloud.within(at, 200).size() == within);
    CHECK_FALSE(cloud.nearest(at, 0.9 * least));
  }
  CHECK_FALSE(fit::PointCloud().nearest({0, 0}, 1e9));
}

TEST_CASE("a scan match finds the motion, with an uncertainty that covers it") {
  const auto walls = room::furnished();
  const room::Pose second{60, -30, 0.06};
  int covered[3] = {0, 0, 0};
  const int seeds = 60;
  double squares[3] = {0, 0, 0}, squares_points = 0;
  for (unsigned seed = 0; seed < seeds; ++seed) {
    const fit::PointCloud reference(fit::orient_sweep(seen_from(walls, {0, 0, 0}, 5, 100 + seed)));
    const auto points = seen_from(walls, second, 5, 500 + seed);
    const auto match = fit::match_to_lines(reference, points, {});
    REQUIRE(match.converged);
    const double e[3] = {match.pose.x_mm - 60, match.pose.y_mm + 30, match.pose.heading_rad - 0.06};
    for (int i = 0; i < 3; ++i) {
      covered[i] += std::abs(e[i]) < 2 * std::sqrt(match.covariance(i, i));
      squares[i] += e[i] * e[i] / seeds;
    }
    const auto baseline = fit::match_to_points(reference, points, {});
    squares_points += std::pow(std::hypot(baseline.pose.x_mm - 60, baseline.pose.y_mm + 30), 2) / seeds;
  }
  CAPTURE(covered[0], covered[1], covered[2], std::sqrt(squares[0]), std::sqrt(squares[1]),
          std::sqrt(squares[2]), std::sqrt(squares_points));
  for (int i = 0; i < 3; ++i) CHECK(covered[i] >= 0.88 * seeds);
  CHECK(std::sqrt(squares[0] + squares[1]) < 1.5);
  CHECK(std::sqrt(squares[2]) < 0.0006);
  CHECK(std::sqrt(squares[0] + squares[1]) < std::sqrt(squares_points));
}

TEST_CASE("along a corridor the match does not slide, where the baseline does") {
  const std::vector<room::Wall> corridor{{{-9000, -900}, {9000, -900}}, {{-9000, 900}, {9000, 900}}};
  const fit::PointCloud reference(fit::orient_sweep(seen_from(corridor, {0, 0, 0}, 5, 1, 4000)));
  const auto points = seen_from(corridor, {150, 20, 0.02}, 5, 2, 4000);
  const Pose2 guess{148, 0, 0};  // odometry is good along the corridor
  const auto match = fit::match_to_lines(reference, points, guess, {5, 0.05});
  CHECK(match.observability < 0.02);
  CHECK(std::abs(match.pose.x_mm - 148) < 8);
  CHECK(match.pose.y_mm == Approx(20).margin(3));
  CHECK(match.pose.heading_rad == Approx(0.02).margin(0.003));
  CHECK(std::sqrt(match.covariance(0, 0)) > 2);
  fit::IcpOptions patient;
  patient.iterations = 300;
  const auto baseline = fit::match_to_points(reference, points, guess, patient);
  CHECK(std::abs(baseline.pose.x_mm - 150) > 5 * std::abs(match.pose.x_mm - 150));
}

TEST_CASE("people walking by do not pull the match") {
  const auto walls = room::furnished();
  auto moved = walls;
  moved.push_back({{900, 200}, {900, 700}});
  const fit::PointCloud reference(fit::orient_sweep(seen_from(walls, {0, 0, 0}, 5, 3)));
  const auto match = fit::match_to_lines(reference, seen_from(moved, {30, 10, 0.03}, 5, 4), {});
  CHECK((match.pose.position() - Vector2d(30, 10)).norm() < 3);
  CHECK(match.pose.heading_rad == Approx(0.03).margin(0.0015));
}

TEST_CASE("the nearest point and those within a radius are those that looking at every point finds") {
  std::mt19937 random(11);
  for (const double size : {300.0, 5'000.0, 60'000.0}) {
    std::uniform_real_distribution<double> place(-size, size);
    std::vector<fit::OrientedPoint> points(700);
    for (auto& point : points) point.at_mm = {place(random), 0.3 * place(random)};
    const fit::PointCloud cloud(points);
    for (int k = 0; k < 300; ++k) {
      const Eigen::Vector2d at(1.2 * place(random), 0.5 * place(random));
      const double reach = 0.1 * size * (1 + k % 3);
      double least = reach;
      const fit::OrientedPoint* expected = nullptr;
      std::size_t inside = 0;
      for (const auto& point : cloud.points()) {
        const double d = (point.at_mm - at).norm();
        if (d <= least) least = d, expected = &point;
        inside += d < reach;
      }
      CHECK(cloud.nearest(at, reach) == expected);
      CHECK(cloud.within(at, reach).size() == inside);
    }
  }
  CHECK(fit::PointCloud().nearest({0, 0}, 100) == nullptr);
}

}  // namespace icp_test
