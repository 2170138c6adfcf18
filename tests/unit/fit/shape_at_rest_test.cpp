// SPDX-License-Identifier: MIT
#include "fit/motion/shape_at_rest.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "tests/support/moving_room.hpp"

namespace shape_at_rest_test {
namespace {

using Eigen::Vector2d;
using room::deg;

/// One scan of a furnished room by a lidar that turns about its own axis, every beam cast at its own time.
fit::Sweep scan(double heading_deg, double rate_deg_s, double sigma_mm, std::mt19937& random) {
  static const std::vector<room::Wall> walls = room::furnished();
  fit::CaptureInfo capture;
  capture.last_step = 1080;
  const auto ranges = room::scan(
      walls,
      [&](double t) {
        return room::Pose{0, 0, (heading_deg + rate_deg_s * t) * deg};
      },
      0, sigma_mm, random);
  fit::ScanView view;
  view.range_mm = ranges;
  return fit::sweep_of(view, capture, {});
}

/// The room as so many scans from its middle show it.
fit::ShapeAtRest at_rest(int scans, double sigma_mm, std::mt19937& random) {
  std::vector<fit::Sweep> sweeps;
  for (int i = 0; i < scans; ++i) sweeps.push_back(scan(0, 0, sigma_mm, random));
  std::vector<fit::ShapeAtRest::Scan> list;
  for (const fit::Sweep& sweep : sweeps) list.push_back({sweep, {}});
  return fit::ShapeAtRest(list);
}

std::vector<Vector2d> points_of(const fit::Sweep& sweep) {
  std::vector<Vector2d> points;
  for (const fit::SweptPoint& point : sweep.points) points.push_back(point.at_mm);
  return points;
}

}  // namespace

TEST_CASE("scans at rest lie on the scene as far as their noise lets them, wherever they are thought to be") {
  std::mt19937 random(3);
  const fit::ShapeAtRest scene = at_rest(30, 4, random);
  for (const fit::Pose2 guess : {fit::Pose2{0, 0, 0}, fit::Pose2{15, -10, 0.01}}) {
    const double off = scene.distance_of(points_of(scan(0, 0, 4, random)), guess);
    // Less than 4 mm where walls are seen aslant.
    CHECK(off > 2);
    CHECK(off < 4.3);
  }
}

TEST_CASE("a scan of a turning lidar is bent, and straight again once every beam is placed at its own time") {
  std::mt19937 random(4);
  const fit::ShapeAtRest scene = at_rest(30, 2, random);
  const double unbent = scene.distance_of(points_of(scan(0, 0, 2, random)), {});
  const fit::Sweep turning = scan(0, 60, 2, random);
  const fit::Path path({{-1, {0, 0, -60 * deg}}, {1, {0, 0, 60 * deg}}});
  const double bent = scene.distance_of(points_of(turning), {}),
               straight = scene.distance_of(fit::deskew(turning, path, {}), {});
  INFO(unbent << ", " << bent << " -> " << straight);
  CHECK(bent > 2 * unbent);
  CHECK(straight < 1.15 * unbent);
}

TEST_CASE("nothing is said of scans that meet no surface of the scene") {
  std::mt19937 random(5);
  CHECK(fit::ShapeAtRest().empty());
  CHECK(at_rest(0, 2, random).empty());
  const fit::ShapeAtRest scene = at_rest(1, 2, random);
  const std::vector<Vector2d> elsewhere(200, Vector2d(90'000, 90'000));
  CHECK(std::isnan(scene.distance_of(elsewhere, {})));
}

}  // namespace shape_at_rest_test
