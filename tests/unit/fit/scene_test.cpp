// SPDX-License-Identifier: MIT
#include "fit/bench/scene.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <optional>
#include <string>

#include "fit/mechanism.hpp"
#include "plain_bench.hpp"

namespace scene_test {
namespace {

using Eigen::Vector2d;
using plain_bench::degree;
using plain_bench::Point;
using plain_bench::Wall;

/// A room with a partition, an outward corner (between walls 2 and 3), a free board before a wall, and a
/// slant.
const std::vector<Wall> flat{{{3000, -2000}, {3000, 1000}},      {{3000, 1000}, {1200, 1000}},
                             {{1200, 1000}, {1200, 3500}},       {{1200, 3500}, {-2200, 2900}},
                             {{-2200, 2900}, {-2500, -2000}},    {{-2500, -2000}, {3000, -2000}},
                             {{-2395.918, -300}, {-1100, -300}}, {{2000, -900}, {2100, -400}}};
struct Post {
  Point centre;
  double radius;
};
const std::vector<Post> posts{{{-600, 1500}, 60}, {{900, -1200}, 25}};

fit::Bench bench_of_all() {
  std::string text = R"({"schema": "bench/1", "targets": [)";
  for (std::size_t i = 0; i < flat.size(); ++i)
    text += (i ? "," : "") + std::string(R"({"name": "w)") + std::to_string(i) + R"(", "from_mm": [)" +
            std::to_string(flat[i].from.real()) + "," + std::to_string(flat[i].from.imag()) +
            R"(], "to_mm": [)" + std::to_string(flat[i].to.real()) + "," + std::to_string(flat[i].to.imag()) +
            "]}";
  for (std::size_t i = 0; i < posts.size(); ++i)
    text += R"(,{"name": "p)" + std::to_string(i) + R"(", "centre_mm": [)" +
            std::to_string(posts[i].centre.real()) + "," + std::to_string(posts[i].centre.imag()) +
            R"(], "radius_mm": )" + std::to_string(posts[i].radius) + R"(, "u_mm": 2, "u_radius_mm": 0.5})";
  return fit::parse_bench(text + "]}");
}

/// Range by complex numbers, of walls and posts; 0: nothing.
double plain_range(Point start, double bearing) {
  double nearest = 1e12;
  const Point turn = std::polar(1.0, -bearing);
  for (const Wall& wall : flat) {
    const Point from = (wall.from - start) * turn, to = (wall.to - start) * turn;
    if ((from.imag() > 0) == (to.imag() > 0)) continue;
    const double at = (from + from.imag() / (from.imag() - to.imag()) * (to - from)).real();
    if (at > 0) nearest = std::min(nearest, at);
  }
  for (const Post& post : posts) {
    const Point way = (post.centre - start) * turn;
    const double half = post.radius * post.radius - way.imag() * way.imag();
    if (half > 0 && way.real() > 0) nearest = std::min(nearest, way.real() - std::sqrt(half));
  }
  return nearest < 1e11 ? nearest : 0;
}

}  // namespace

TEST_CASE("a scene of any walls and posts is met where rays cross it") {
  const fit::Scene scene(bench_of_all());
  for (const Point start : {Point(0, 0), Point(100, -200), Point(-900, 700)})
    for (double bearing_deg = -180; bearing_deg < 180; bearing_deg += 0.0917) {
      INFO("from " << start << " at " << bearing_deg << " deg");
      const fit::Hit hit = scene.look({start.real(), start.imag()}, bearing_deg * degree);
      CHECK(hit.range_mm == Approx(plain_range(start, bearing_deg * degree)).margin(0.01));
    }
}

TEST_CASE("slopes of a range along place and shape of a target are those of small changes") {
  const fit::Bench bench = bench_of_all();
  const Vector2d origin(30, -40);
  const auto range = [&](int target, const fit::Stands& stands, double bearing) {
    std::vector<fit::Stands> all(bench.targets.size());
    all[static_cast<std::size_t>(target)] = stands;
    return fit::Scene(bench, all).look_at(target, origin, bearing).range_mm;
  };
  int seen = 0;
  for (double bearing_deg = -180; bearing_deg < 180; bearing_deg += 1.7) {
    const double bearing = bearing_deg * degree, small = 1e-3;
    const fit::Hit hit = fit::Scene(bench).look(origin, bearing);
    if (hit.target < 0 || hit.cosine < 0.2) continue;
    INFO(bench.targets[static_cast<std::size_t>(hit.target)].name << " at " << bearing_deg << " deg");
    const auto slope = [&](double fit::Stands::*member) {
      fit::Stands more, less;
      more.*member = small;
      less.*member = -small;
      return (range(hit.target, more, bearing) - range(hit.target, less, bearing)) / (2 * small);
    };
    CHECK(hit.per_out == Approx(slope(&fit::Stands::out_mm)).margin(1e-4));
    if (bench.targets[static_cast<std::size_t>(hit.target)].round) {
      CHECK(hit.per_aside == Approx(slope(&fit::Stands::aside_mm)).margin(1e-3));
      CHECK(hit.per_thicker == Approx(slope(&fit::Stands::thicker_mm)).margin(1e-3));
      ++seen;
    } else {
      CHECK(hit.per_turn == Approx(slope(&fit::Stands::turn_rad)).epsilon(0.01).margin(1));
    }
    fit::Circumstances c;
    fit::Scene(bench).describe(origin, bearing, hit, {}, c);
    const auto act = [&](const char* id, std::vector<double> values) {
      return fit::find_mechanism(id)->act(c, values).range_mm;
    };
    CHECK(act("target-offset", {1, 0}) == Approx(hit.per_out));
    if (c.round) {
      CHECK(act("target-offset", {0, 1}) == Approx(hit.per_aside).margin(1e-9));
      CHECK(act("target-radius", {1}) == Approx(hit.per_thicker));
    }
    const double beam = 1e-6;
    CHECK(hit.range_mm * std::tan(hit.incidence_rad) ==
          Approx((fit::Scene(bench).look_at(hit.target, origin, bearing + beam).range_mm -
                  fit::Scene(bench).look_at(hit.target, origin, bearing - beam).range_mm) /
                 (2 * beam))
              .epsilon(0.01)
              .margin(1));
  }
  CHECK(seen > 2);
}

TEST_CASE("edges are where the range jumps, and nowhere else") {
  const fit::Scene scene(bench_of_all());
  for (const Point start : {Point(0, 0), Point(100, -200)}) {
    const std::vector<fit::Edge> edges = scene.edges({start.real(), start.imag()});
    std::size_t jumps = 0;
    constexpr double step_deg = 0.01;
    for (double bearing_deg = -180; bearing_deg < 180; bearing_deg += step_deg) {
      const double low = plain_range(start, bearing_deg * degree),
                   high = plain_range(start, (bearing_deg + step_deg) * degree);
      const auto* edge = fit::nearest_edge(edges, (bearing_deg + step_deg / 2) * degree);
      const bool has_edge =
          edge && std::abs(fit::wrap_angle(edge->bearing_rad - (bearing_deg + step_deg / 2) * degree)) <
                      0.5001 * step_deg * degree;
      INFO("from " << start << " at " << bearing_deg << " deg: " << low << " to " << high << " mm");
      if (std::abs(high - low) > 60) CHECK(has_edge);
      if (std::abs(high - low) < 5) CHECK_FALSE(has_edge);
      jumps += has_edge;
      if (!has_edge) continue;
      CHECK(edge->near_mm == Approx(std::min(low, high)).margin(15));
      CHECK(edge->near_side == (high < low ? 1 : -1));
      CHECK((edge->far_mm > 0 ? edge->far_mm : 0) == Approx(std::max(low, high)).margin(15));
    }
    CHECK(jumps == edges.size());
    CHECK(edges.size() >= 7);
  }
}

TEST_CASE(
    "an outward corner hides nothing of its other wall when one of them is moved, and is no inner corner") {
  const fit::Bench bench = bench_of_all();
  std::vector<fit::Stands> stands(bench.targets.size());
  stands[1].out_mm = 60;
  stands[2].turn_rad = 1 * degree;
  const fit::Scene scene(bench, stands);
  // The corner at (1200, 1000) is seen from the left of wall 2 and from below wall 1: both faces.
  int before = -1, changes = 0;
  for (double bearing_deg = 30; bearing_deg < 50; bearing_deg += 0.01) {
    const fit::Hit hit = scene.look({0, 0}, bearing_deg * degree);
    if (before >= 0 && hit.target != before) ++changes;
    before = hit.target;
    REQUIRE(hit.target >= 0);
    if (hit.target == 1 && hit.along_mm > 0) CHECK(scene.to_corner_mm(hit) > 100);
    if (hit.target == 1 || hit.target == 2) CHECK(scene.to_joint_mm(hit) < 4000);
  }
  CHECK(changes == 1);
}

TEST_CASE("a partition that begins on a wall makes two inner corners there") {
  const fit::Scene scene(bench_of_all());
  const fit::Hit above = scene.look({-1500, 0}, 185 * degree);
  REQUIRE(above.target == 4);
  CHECK(scene.to_corner_mm(above) < 400);
  const fit::Hit partition = scene.look({-1500, 0}, 200 * degree);
  REQUIRE(partition.target == 6);
  CHECK(scene.to_corner_mm(partition) < 400);
}

TEST_CASE("a round target keeps its shape in a bench file, and errors say what is wrong") {
  const fit::Bench bench = bench_of_all();
  const fit::Bench again = fit::parse_bench(to_json_text(bench));
  const fit::Target* post = again.target("p0");
  REQUIRE(post);
  REQUIRE(post->round);
  CHECK(post->round->centre_mm == Vector2d(-600, 1500));
  CHECK(post->round->radius_mm == 60);
  CHECK(post->round->u_radius_mm == 0.5);
  CHECK(post->outward_normal().dot(post->from_mm) == Approx(std::hypot(600, 1500) - 60));
  CHECK_THROWS_WITH(fit::parse_bench(R"({"schema": "bench/1", "targets": [{"name": "p", "centre_mm": [30, 0],
    "radius_mm": 40}]})"),
                    Catch::Contains("stage's axis"));
  CHECK_THROWS_WITH(fit::parse_bench(R"({"schema": "bench/1", "targets": [{"name": "p", "centre_mm": [300, 0],
    "radius_mm": 40, "from_mm": [1, 2]}]})"),
                    Catch::Contains("leave one of them out"));
}

TEST_CASE("a surface beside a board pulls it when it is near behind, and counts apart when it is far") {
  for (const double behind_mm : {300.0, 2000.0}) {
    const std::string wall = std::to_string(1000 + behind_mm);
    const fit::Scene scene(fit::parse_bench(
        R"({"schema": "bench/1", "targets": [{"name": "board", "from_mm": [1000, -300], "to_mm": [1000, 0],
      "reflectance": 0.2}, {"name": "wall", "from_mm": [)" +
        wall + R"(, -4000], "to_mm": [)" + wall + R"(, 4000], "reflectance": 0.8}]})"));
    const double bearing = -0.1 * degree;
    const fit::Hit board = scene.look({0, 0}, bearing);
    REQUIRE(board.target == 0);
    fit::Circumstances at;
    for (int twice = 0; twice < 2; ++twice)  // the second time nothing is left of the first
      scene.describe({0, 0}, bearing, board, scene.edges({0, 0}), at);
    // By hand: beams at 0.25 to 1 deg on the one side meet the wall.
    const double light = 0.8 / 0.2 * std::pow(1000 / (1000 + behind_mm), 2), gap = std::min(behind_mm, 500.0);
    double reaches = 0;
    for (const double angle : {0.25, 0.5, 0.75, 1.0}) reaches += std::exp2(-std::pow(angle / 0.7, 2));
    const bool merges = behind_mm < 500;
    CHECK_FALSE(at.alone);
    CHECK(at.pull_mm[1] == Approx(merges ? light * gap * reaches : 0).epsilon(0.01).margin(0.5));
    CHECK(at.pull_apart_mm[1] == Approx(merges ? 0 : light * gap * reaches).epsilon(0.01));
    CHECK(at.pull_front_mm[1] == Approx(merges ? -light * 150 * reaches : 0).epsilon(0.01).margin(0.5));
  }
}

TEST_CASE("a slanted wall pulls its own beams by what lies beside them, in an inner corner both walls do") {
  const fit::Scene scene(fit::parse_bench(
      R"({"schema": "bench/1", "targets": [{"name": "ahead", "from_mm": [2000, -9000], "to_mm": [2000, 3000]},
      {"name": "left", "from_mm": [2000, 3000], "to_mm": [-2000, 3000]}]})"));
  const double corner = std::atan2(3000.0, 2000.0);
  for (const double bearing : {-60 * degree, 0.0, 40 * degree, corner - 0.3 * degree}) {
    const auto range_mm = [](double b) {
      return std::min(2000 / std::cos(b), b > 0 ? 3000 / std::sin(b) : 1e9);
    };
    const auto light = [&](double b) {
      return (b < corner ? std::cos(b) : std::sin(b)) / std::pow(range_mm(b), 2);
    };
    fit::Circumstances at;
    scene.describe({0, 0}, bearing, scene.look({0, 0}, bearing), scene.edges({0, 0}), at);
    CHECK(at.alone == (bearing < 50 * degree));
    double pull_mm = 0, front_mm = 0;
    for (const double aside : {-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0}) {
      const double other = bearing + aside * degree, gap = range_mm(other) - range_mm(bearing);
      const double share = light(other) / light(bearing) * std::exp2(-std::pow(aside / 0.5, 2));
      pull_mm += share * gap;
      front_mm -= share * gap * gap / 150;
    }
    CHECK(at.pull_mm[0] == Approx(pull_mm).epsilon(1e-3).margin(1e-9));
    CHECK(at.pull_front_mm[0] == Approx(front_mm).epsilon(1e-3).margin(1e-9));
    CHECK(at.pull_apart_mm[0] == 0);
  }
}

TEST_CASE("a ray that passes a post tells what it would meet nearest, with a slope that is finite") {
  const fit::Bench bench = bench_of_all();
  const auto post = static_cast<int>(flat.size());
  const double middle = std::arg(posts[0].centre),
               half = std::asin(posts[0].radius / std::abs(posts[0].centre));
  for (const double aside : {0.999, 1.0, 1.001, 1.3, 2.0}) {
    const fit::Hit hit = fit::Scene(bench).look_at(post, Vector2d::Zero(), middle + aside * half);
    INFO(aside << " half widths from its middle");
    CHECK(std::abs(std::tan(hit.incidence_rad)) < 60);
    CHECK(std::abs(hit.range_mm - std::abs(posts[0].centre)) < posts[0].radius);
  }
}

}  // namespace scene_test
