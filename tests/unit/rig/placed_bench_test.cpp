// SPDX-License-Identifier: MIT
#include "rig/runner/placed_bench.hpp"

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

namespace placed_bench_test {
namespace {

fit::CaptureInfo described(const rig::PlacedBench& bench, const std::string& target,
                           std::int64_t started_us) {
  fit::CaptureInfo capture;
  capture.target = target;
  capture.started_us = started_us;
  bench.describe(capture);
  return capture;
}

}  // namespace

TEST_CASE("captures are recorded with what the prompts before them placed, in a resumed run too") {
  rig::PlacedBench bench;
  rig::Placement placement;
  placement.target = "board", placement.shift_mm = 100, placement.reflectance = 0.2;
  bench.place(placement, 0);
  placement = {};
  placement.target = "board", placement.shift_mm = 250;  // The surface stays.
  bench.place(placement, 0);
  placement = {};
  placement.temperature_c = 31, placement.since_power_on_s = 60;
  bench.place(placement, 100'000'000);

  rig::PlacedBench resumed;
  resumed.restore(bench.placements_json(), *bench.power_on_us());
  for (const rig::PlacedBench* each : {&bench, &resumed}) {
    const fit::CaptureInfo board = described(*each, "board", 110'000'000),
                           other = described(*each, "wall", 110'000'000);
    CHECK(board.target_shift_mm == 250);
    CHECK(board.reflectance == 0.2);
    CHECK(board.temperature_c == 31);
    CHECK(board.since_power_on_s == 70);
    CHECK(other.target_shift_mm == 0);
    CHECK_FALSE(other.reflectance);
    CHECK(each->has_placed("board"));
    CHECK_FALSE(each->has_placed("wall"));
  }

  fit::Target target;
  target.name = "board";
  target.from_mm = {1000, -200}, target.to_mm = {1000, 200}, target.reflectance = 0.85;
  CHECK(bench.as_placed(target).from_mm.x() == Approx(1250));
  CHECK(bench.as_placed(target).reflectance == 0.2);
}

TEST_CASE("what is no record of placements changes nothing") {
  rig::PlacedBench bench;
  bench.restore("nonsense", nullptr);
  CHECK(bench.placements().empty());
  CHECK_FALSE(bench.power_on_us());
}

TEST_CASE("a target that was moved is not forgotten by captures that name none") {
  rig::PlacedBench bench;
  const auto put = [&](const std::string& target, double shift_mm) {
    rig::Placement placement;
    placement.target = target, placement.shift_mm = shift_mm;
    bench.place(placement, 0);
  };
  const auto of_none = [&] {
    fit::CaptureInfo capture;
    bench.describe(capture);
    return capture;
  };
  put("left", 0);
  CHECK_FALSE(of_none().target);
  put("left", 100);
  CHECK(of_none().target == "left");
  CHECK(of_none().target_shift_mm == 100);
  CHECK(bench.moved_beside("left").empty());
  CHECK(bench.moved_beside("front") == std::vector<std::string>{"left"});
  put("front", -20);
  CHECK_FALSE(of_none().target);  // one of two cannot be recorded
  CHECK(bench.moved_beside(std::nullopt) == std::vector<std::string>{"front", "left"});
  CHECK(bench.moved_beside("front") == std::vector<std::string>{"left"});
  put("left", 0);
  CHECK(of_none().target == "front");
}

}  // namespace placed_bench_test
