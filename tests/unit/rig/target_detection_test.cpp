// SPDX-License-Identifier: MIT
#include "rig/runner/target_detection.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "rig/runner/bench_doubts.hpp"

namespace target_detection_test {

using Catch::Matchers::Contains;
using Outcome = rig::TargetDetection::Outcome;

namespace {

fit::Target target_at(const std::string& name, Eigen::Vector2d from, Eigen::Vector2d to) {
  fit::Target target;
  target.name = name;
  target.from_mm = from, target.to_mm = to;
  target.u_mm = 1, target.u_rad = 0.1 * fit::rad_per_deg;
  return target;
}

fit::Bench one_board() {
  fit::Bench bench;
  bench.lidar.mount.x_mm.u = bench.lidar.mount.y_mm.u = 2;
  bench.targets = {target_at("board", {1400, -200}, {1400, 200})};
  bench.document = "{}";
  return bench;
}

/// What the lidar sees when `targets` are really there, with 3 mm of noise and `bias_mm`.
rig::BeamMedians seen_of(const fit::Bench& bench, const std::vector<fit::Target>& targets, double stage_rad,
                         double bias_mm = 0) {
  rig::BeamMedians seen;
  const auto none = std::nan("");
  seen.range_mm.assign(static_cast<std::size_t>(bench.lidar.steps), none);
  seen.intensity = seen.range_mm;
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(0, 3);
  for (fit::Target target : targets) {
    // expected_ranges_mm leaves the ends out; here they are seen as well.
    const Eigen::Vector2d more = 0.125 * (target.to_mm - target.from_mm);
    target.from_mm -= more, target.to_mm += more;
    const auto ranges = rig::expected_ranges_mm(bench, target, stage_rad);
    for (std::size_t k = 0; k < ranges.size(); ++k)
      if (std::isfinite(ranges[k]) && !(seen.range_mm[k] < ranges[k])) {
        seen.range_mm[k] = ranges[k] + bias_mm + noise(random);
        seen.intensity[k] = 1500;
      }
  }
  return seen;
}

}  // namespace

TEST_CASE("a target that stands where it was asked for is seen there, from any stage angle that shows it") {
  const fit::Bench bench = one_board();
  for (const double stage_deg : {-100.0, -30.0, 0.0, 60.0, 110.0}) {
    const double stage_rad = stage_deg * fit::rad_per_deg;
    const auto detection = rig::detect_target(bench, bench.targets[0], {}, stage_rad,
                                              seen_of(bench, bench.targets, stage_rad, 30));
    INFO(stage_deg << ": " << detection.words);
    CHECK(detection.outcome == Outcome::in_place);
    CHECK(detection.seen_mm == Approx(1430).margin(3));
    CHECK(detection.intensity == 1500);
  }
}

TEST_CASE(
    "a target that was not moved, is 0.4 m off, turned, covered or gone is reported with what is seen") {
  const fit::Bench bench = one_board();
  const fit::Target& board = bench.targets[0];
  const auto detect = [&](const std::vector<fit::Target>& really) {
    return rig::detect_target(bench, board, {}, 0, seen_of(bench, really, 0));
  };
  const auto off = detect({rig::shifted(board, 400)});
  CHECK(off.outcome == Outcome::misplaced);
  CHECK(off.to_go_mm == Approx(400).margin(3));
  CHECK_THAT(off.words, Contains("farther away than asked, at 180") && Contains("instead of 1400 mm"));
  CHECK(detect({rig::shifted(board, -60)}).outcome == Outcome::misplaced);
  CHECK_THAT(detect({rig::shifted(board, -60)}).words, Contains("nearer"));
  CHECK(detect({rig::shifted(board, 20)}).outcome == Outcome::in_place);
  CHECK(detect({}).outcome == Outcome::undetected);
  const auto turned = detect({target_at("board", {1435, -200}, {1365, 200})});
  CHECK(turned.outcome == Outcome::misplaced);
  CHECK_THAT(turned.words, Contains("turned by"));
  CHECK(detect({target_at("board", {1400, 30}, {1400, 430}), target_at("wall", {2500, -900}, {2500, 900})})
            .outcome == Outcome::misplaced);
}

TEST_CASE("a target behind another is judged by the beams that pass, and one out of view is not judged") {
  const fit::Bench bench = one_board();
  const fit::Target wall = target_at("wall", {2200, -900}, {2200, 900});
  const std::vector<fit::Target> both = {bench.targets[0], wall};
  CHECK(rig::detect_target(bench, wall, both, 0, seen_of(bench, both, 0)).outcome == Outcome::in_place);
  CHECK(
      rig::detect_target(bench, wall, both, 0, seen_of(bench, {bench.targets[0], rig::shifted(wall, 300)}, 0))
          .outcome == Outcome::misplaced);
  const double behind = fit::pi;
  CHECK(rig::detect_target(bench, wall, both, behind, seen_of(bench, both, behind)).outcome ==
        Outcome::out_of_view);
}

TEST_CASE("a stated accuracy or a tolerance decides how far off a target may be seen") {
  fit::Bench bench = one_board();
  const auto seen = seen_of(bench, {rig::shifted(bench.targets[0], 70)}, 0);
  CHECK_FALSE(rig::detect_target(bench, bench.targets[0], {}, 0, seen).good());
  CHECK(rig::detect_target(bench, bench.targets[0], {}, 0, seen, 80).good());
  bench.document = R"({"lidar": {"largest_error_mm": 80}})";
  CHECK(rig::detect_target(bench, bench.targets[0], {}, 0, seen).good());
}

TEST_CASE("values of a bench file that are out of all proportion are named, usual ones are not") {
  CHECK(rig::doubts_about(one_board()).empty());
  const auto doubt = [](auto change) {
    fit::Bench bench = one_board();
    change(bench);
    const auto doubts = rig::doubts_about(bench);
    REQUIRE(doubts.size() == 1);
    return doubts[0];
  };
  CHECK_THAT(doubt([](fit::Bench& b) {
               b.targets.push_back(target_at("tile", {1.4, -0.2}, {1.4, 25}));
             }),
             Contains("'tile'") && Contains("metres"));
  CHECK_THAT(doubt([](fit::Bench& b) { b.targets[0].to_mm = {1400, -195}; }), Contains("5 mm wide"));
  CHECK_THAT(doubt([](fit::Bench& b) { b.targets[0].reflectance = 85; }), Contains("per cent"));
  CHECK_THAT(doubt([](fit::Bench& b) { b.lidar.mount.x_mm.value = 1400; }), Contains("1400 mm from"));
  CHECK_THAT(doubt([](fit::Bench& b) { b.lidar.scan_hz = 0.025; }), Contains("scan_hz"));
  CHECK_THAT(doubt([](fit::Bench& b) { b.document = R"({"stage": {"limits_deg": [-2.9, 2.9]}})"; }),
             Contains("radians"));
  CHECK_THAT(doubt([](fit::Bench& b) { b.document = R"({"stage": {"tolerance_deg": 20}})"; }),
             Contains("loses steps"));
}

}  // namespace target_detection_test
