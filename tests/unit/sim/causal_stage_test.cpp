// SPDX-License-Identifier: MIT
// Each effect emerges from its cause: observables against closed forms, scaling laws and limits that the
// engine itself does not contain. The stage; and the order of draws.
#include <algorithm>
#include <catch2/catch.hpp>

#include "causal_support.hpp"

namespace causal_stage_test {

using namespace causal_test;
using Catch::Detail::Approx;

namespace {

/// Bearing of the lidar's front as a slanted wall tells it, for a drive that stands at `drive_rad`.
double seen_angle(const sim::World& world, sim::Engine& engine, double time, double drive_rad) {
  const Recording recording = record_steps(engine, world.bench.lidar, 200, time, [&](double) {
    return sim::StageMoment{drive_rad, 0};
  });
  const double r = recording.at(0).mean(), i = 45 * fit::rad_per_deg;
  return std::acos(2000 * std::cos(i) / r) - i;
}

}  // namespace

TEST_CASE("the worm's run-out bends stage angles with the period of its teeth, the wheel's once a turn") {
  sim::World world = narrow(slanted(2000, 45), 1);
  world.stage.worm_rad = 1e-3;
  world.stage.worm_teeth = 90;
  auto engine = sim::make_causal_engine(world, 1);
  for (const double deg : {0.0, 1.0, 2.0, 3.0}) {
    const double drive = deg * fit::rad_per_deg;
    CHECK(seen_angle(world, *engine, 10, drive) - drive == Approx(1e-3 * std::sin(90 * drive)).margin(1e-4));
  }
  world.stage.worm_rad = 0;
  world.stage.wheel_rad = 2e-3;
  engine = sim::make_causal_engine(world, 1);
  for (const double deg : {-20.0, 10.0}) {
    const double drive = deg * fit::rad_per_deg;
    CHECK(seen_angle(world, *engine, 10, drive) - drive == Approx(2e-3 * std::sin(drive)).margin(1e-4));
  }
}

TEST_CASE("gear play leaves the table short of the drive on whichever side it comes from") {
  sim::World world = narrow(slanted(2000, 45), 1);
  world.stage.play_rad = 2e-3;
  const auto engine = sim::make_causal_engine(world, 1);
  seen_angle(world, *engine, 0, -0.1);
  const double from_below = seen_angle(world, *engine, 10, 0);
  seen_angle(world, *engine, 20, 0.1);
  const double from_above = seen_angle(world, *engine, 30, 0);
  CHECK(from_above - from_below == Approx(2e-3).margin(1.5e-4));
  // A move smaller than the play does not move the table.
  CHECK(seen_angle(world, *engine, 40, 1e-3) == Approx(from_above).margin(1.5e-4));
}

TEST_CASE("after a stop the table rings at its own frequency, from the moment it stopped") {
  sim::World world = narrow(slanted(2000, 45), 1);
  world.stage.ring_rad = 3e-3;
  world.stage.ring_hz = 5;
  world.stage.ring_decay_s = 0.3;
  const auto stage = [](double t) {
    return t < 0.95 ? sim::StageMoment{0.2 * (t - 0.95), 0.2} : sim::StageMoment{0, 0};
  };
  const auto engine = sim::make_causal_engine(world, 1);
  std::vector<std::uint32_t> range(9), intensity(9);
  engine->scan(0, stage, range, intensity);
  for (int i = 0; i < 8; ++i) {
    const double t = 1.0 + 0.025 * i, since = t - 0.95;
    engine->scan(t, stage, range, intensity);
    const double swing = 3e-3 * std::exp(-since / 0.3) * std::cos(2 * fit::pi * 5 * since);
    CHECK(range[4] == Approx(along_slant(2000, 45, swing)).margin(2.5));
  }
}

TEST_CASE("run-out moves the axis, an arm turns with the stage, and a late stamp shows with the rate") {
  sim::World world = narrow(wall_at(2000), 1);
  world.stage.runout_mm = 2;
  const auto at = [&](const sim::World& one, const std::function<sim::StageMoment(double)>& stage) {
    const auto engine = sim::make_causal_engine(one, 1);
    return record_steps(*engine, one.bench.lidar, 200, 1, stage).at(0).mean();
  };
  const auto still = [](double angle) { return [angle](double) { return sim::StageMoment{angle, 0}; }; };
  CHECK(at(world, still(0)) == Approx(1998).margin(0.3));
  world = narrow(wall_at(2000), 1);
  world.mount_x_mm = 20;
  CHECK(at(world, still(0)) == Approx(1980).margin(0.3));
  CHECK(at(world, still(0.3)) == Approx((2000 - 20 * std::cos(0.3)) / std::cos(0.3)).margin(0.4));
  world = narrow(slanted(2000, 45), 1);
  world.stage.late_s = 0.02;
  const auto turning = [](double t) { return sim::StageMoment{0.1 * (t - 3.5), 0.1}; };
  const sim::World prompt = narrow(slanted(2000, 45), 1);
  CHECK(at(world, turning) - at(prompt, turning) == Approx(-2000 * 0.1 * 0.02).epsilon(0.25));
}

TEST_CASE("while the stage turns, later beams are seen from later angles") {
  sim::World world = wall_at(2000);
  const double rate = 1.0;
  const auto turning = [&](double t) { return sim::StageMoment{rate * (t - 1), rate}; };
  std::vector<std::uint32_t> range(1081), intensity(1081);
  sim::make_causal_engine(world, 1)->scan(1, turning, range, intensity);
  for (const int step : {400, 540, 680}) {
    const double bearing = world.bench.lidar.beam_angle(step) + rate * world.bench.lidar.beam_time_s(step);
    CHECK(range[static_cast<std::size_t>(step)] == Approx(2000 / std::cos(bearing)).margin(3));
  }
  world.rotor.rolling = false;
  sim::make_causal_engine(world, 1)->scan(1, turning, range, intensity);
  CHECK(range[680] == Approx(2000 / std::cos(world.bench.lidar.beam_angle(680))).margin(3));
}

TEST_CASE("the same seed gives the same scans, another one others") {
  const sim::World world = narrow(wall_at(2000, 0.5));
  CHECK(record(world, 5, 0, 7).at(3).ranges == record(world, 5, 0, 7).at(3).ranges);
  CHECK(record(world, 5, 0, 7).at(3).ranges != record(world, 5, 0, 8).at(3).ranges);
}

}  // namespace causal_stage_test
