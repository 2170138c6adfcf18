// SPDX-License-Identifier: MIT
#include "fit/range/centre.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <random>

namespace centre_test {
namespace {

constexpr double deg = fit::rad_per_deg;

Eigen::Vector2d turned(const Eigen::Vector2d& v, double rad) {
  return {std::cos(rad) * v.x() - std::sin(rad) * v.y(), std::sin(rad) * v.x() + std::cos(rad) * v.y()};
}

const Eigen::Vector2d true_centre(-1.63, -12.65);
const Eigen::Vector2d point_about_axis(1380, -190);

/// The turns of source A: 54, 119 and 34.5 deg from one position to the next.
std::vector<fit::CentrePoint> sights(double u_range, double u_angle, std::mt19937_64* random) {
  std::normal_distribution<double> normal;
  std::vector<fit::CentrePoint> points;
  for (const double stage : {-100.0, -46.0, 73.0, 107.5}) {
    const Eigen::Vector2d p = turned(point_about_axis, -stage * deg) + true_centre;
    fit::CentrePoint point;
    point.stage_rad = stage * deg;
    point.beam_rad = std::atan2(p.y(), p.x()) + (random ? u_angle * normal(*random) : 0);
    point.range_mm = p.norm() + (random ? u_range * normal(*random) : 0);
    point.u_range_mm = u_range, point.u_angle_rad = u_angle;
    points.push_back(point);
  }
  return points;
}

}  // namespace

TEST_CASE("the corrected triangle formula gives the centre of the lidar's turn") {
  const auto points = sights(0.1, 1e-5, nullptr);
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t j = i + 1; j < points.size(); ++j)
      CHECK((fit::centre_of_pair(points, i, j).centre - true_centre).norm() < 1e-9);
  CHECK_THROWS(fit::centre_from_pair({1, 2}, {1, 2}, 0));
}

TEST_CASE("all sights together give the centre, and covariance says how well") {
  std::mt19937_64 random(7);
  int x_inside = 0, y_inside = 0;
  double chi2 = 0;
  constexpr int runs = 400;
  for (int run = 0; run < runs; ++run) {
    const auto fit = fit::fit_centre(sights(0.2, 0.0002, &random));
    x_inside += std::abs(fit.centre.x() - true_centre.x()) < 2 * std::sqrt(fit.covariance(0, 0));
    y_inside += std::abs(fit.centre.y() - true_centre.y()) < 2 * std::sqrt(fit.covariance(1, 1));
    chi2 += fit.chi2;
    CHECK(fit.degrees_of_freedom == 4);
  }
  CHECK(x_inside > 0.93 * runs);
  CHECK(x_inside < 0.985 * runs);
  CHECK(y_inside > 0.93 * runs);
  CHECK(y_inside < 0.985 * runs);
  CHECK(chi2 / runs == Approx(4).epsilon(0.15));
}

TEST_CASE("pairs, and their mean, are as uncertain as the stage that turned between them allows") {
  std::mt19937_64 random(9);
  std::normal_distribution<double> normal;
  constexpr double u_scale = 0.002, u_range = 0.2, u_angle = 0.0002;
  constexpr int runs = 400;
  int pair_inside = 0, mean_inside = 0, without = 0;
  for (int run = 0; run < runs; ++run) {
    auto points = sights(u_range, u_angle, &random);
    const double scale = u_scale * normal(random);
    fit::CentreEffect turns{"scale of the stage", {}};
    for (fit::CentrePoint& point : points) {
      turns.shift_mm.emplace_back(0, u_scale * point.range_mm * point.stage_rad);
      point.beam_rad += scale * point.stage_rad;
    }
    const fit::CentrePair pair = fit::centre_of_pair(points, 0, 2, {turns});
    const fit::CentreMean mean =
        fit::mean_of_pairs(points,
                           {fit::centre_of_pair(points, 0, 1), fit::centre_of_pair(points, 1, 2),
                            fit::centre_of_pair(points, 2, 3)},
                           {turns});
    const auto holds = [](const Eigen::Vector2d& centre, const Eigen::Matrix2d& covariance) {
      return std::abs(centre.x() - true_centre.x()) < 2 * std::sqrt(covariance(0, 0));
    };
    pair_inside += holds(pair.centre, pair.covariance);
    mean_inside += holds(mean.centre, mean.covariance);
    without += holds(pair.centre, fit::centre_of_pair(points, 0, 2).covariance);
  }
  CHECK(pair_inside > 0.93 * runs);
  CHECK(pair_inside < 0.985 * runs);
  CHECK(mean_inside > 0.93 * runs);
  CHECK(mean_inside < 0.985 * runs);
  CHECK(without < 0.6 * runs);
}

TEST_CASE("a small turn makes the centre uncertain and says so") {
  auto points = sights(0.2, 0.0002, nullptr);
  const double wide = fit::centre_of_pair(points, 0, 2).covariance.trace();
  const double narrow = fit::centre_of_pair(points, 2, 3).covariance.trace();
  CHECK(narrow > 5 * wide);
  points[1].stage_rad = points[0].stage_rad;
  points.resize(2);
  CHECK_THROWS_AS(fit::fit_centre(points), std::invalid_argument);
}

TEST_CASE("the board's distance alone gives the same centre, whatever the constant range error") {
  std::vector<fit::BoardLine> lines;
  for (const double stage : {-100.0, -46.0, 73.0, 107.5}) {
    const double normal = -stage * deg;
    lines.push_back({stage * deg, normal,
                     1400 + 8 + std::cos(normal) * true_centre.x() + std::sin(normal) * true_centre.y(), 0.05,
                     60});
  }
  CHECK((fit::fit_centre_from_lines(lines).centre - true_centre).norm() < 1e-9);
}

TEST_CASE("the centre turns with the lidar when points go into the map") {
  // A robot turning about the centre sees a fixed point: it must stay where it is in the map.
  const Eigen::Vector2d world(2000, 700), mount(0, 0);
  for (const double heading : {0.0, 90.0, 180.0, 271.3}) {
    const Eigen::Vector2d seen = turned(world, -heading * deg) + true_centre;
    const Eigen::Vector2d map = fit::to_map(seen.norm(), std::atan2(seen.y(), seen.x()), mount, true_centre,
                                            {10, -20, heading * deg});
    CHECK((map - world - Eigen::Vector2d(10, -20)).norm() < 1e-9);
  }
}

}  // namespace centre_test
