// SPDX-License-Identifier: MIT
// Each effect emerges from its cause: observables against closed forms, scaling laws and limits that the
// engine itself does not contain. Counter, receiver, mirror and code disk.
#include <algorithm>
#include <catch2/catch.hpp>

#include "causal_support.hpp"

namespace causal_device_test {

using namespace causal_test;
using Catch::Detail::Approx;

TEST_CASE("cables, clock and air change the range as lengths do") {
  sim::World world = wall_at(4000);
  world.housing.delay_ns = 0.1;
  CHECK(bias(world, 4000) - bias(wall_at(4000), 4000) == Approx(0.1 * half_light).margin(0.3));
  world = wall_at(4000);
  world.counter.ppm = 3000;
  CHECK(bias(world, 4000) - bias(wall_at(4000), 4000) == Approx(12).margin(0.3));
  world = wall_at(4000);
  world.air.index_error = 1e-3;
  CHECK(bias(world, 4000) - bias(wall_at(4000), 4000) == Approx(4).margin(0.3));
  world = wall_at(200);
  world.receiver.parallax_mm = 40;
  CHECK(bias(world, 200) - bias(wall_at(200), 200) == Approx(40 * 40 / (4 * 200.)).epsilon(0.2));
}

TEST_CASE("a clock that leaks into the comparator makes an error with half its wavelength as period") {
  std::vector<double> error;
  for (double r = 1000; r < 1000 + 2 * 749.5; r += 749.5 / 4) {
    sim::World world = wall_at(r);
    world.receiver.compensation = 0;
    const double clean = bias(world, r);
    world.counter.leak = 1.5e-4;
    world.counter.leak_mhz = 200;  // 749.5 mm there and back
    error.push_back(bias(world, r) - clean);
  }
  for (std::size_t i = 0; i < 4; ++i) CHECK(error[i] == Approx(error[i + 4]).margin(0.8));
  CHECK(error[0] == Approx(-error[2]).margin(0.8));
  CHECK(*std::ranges::max_element(error) > 2);
}

TEST_CASE("counter bins make ranges stick to their multiples") {
  sim::World world = narrow(slanted(2000, 45));
  world.counter.bin_ns = 20 / half_light;
  const Recording recording = record(world, 5);
  for (const Cell& cell : recording.cells) {
    for (const double r : cell.ranges) CHECK(std::abs(std::remainder(r, 20)) <= 1);
  }
}

TEST_CASE(
    "light thrown back inside the housing disturbs near targets most, a glint at its own window angle") {
  const auto pulled = [](double range, double reflectance, bool glint) {
    sim::World world = wall_at(range, reflectance);
    world.receiver.compensation = 0;
    const double clean = bias(world, range);
    (glint ? world.housing.glint : world.housing.flash) = 0.002;
    return bias(world, range) - clean;
  };
  const double near = pulled(300, 1, false);
  CHECK(near < -0.5);
  CHECK(std::abs(pulled(900, 1, false)) < std::abs(near) / 3);
  CHECK(pulled(300, 1, true) == Approx(near).margin(0.3));
  sim::World world = wall_at(300);
  world.housing.glint = 0.002;
  world.housing.glint_centre_rad = 60 * fit::rad_per_deg;
  CHECK(std::abs(bias(world, 300) - bias(wall_at(300), 300)) < 0.3);
}

TEST_CASE("dirt on the window takes light both ways over its sector") {
  sim::World world = wall_at(3000);
  const Recording clean = record(narrow(world), 20);
  world.housing.dirt = {{0.1, 0.08, 0.5}};
  const Recording dirty = record(narrow(world), 20);
  const double beam = std::round(4 * 0.1 * fit::deg_per_rad) / 4;
  CHECK(dirty.at(beam).intensity / clean.at(beam).intensity == Approx(0.5).epsilon(0.06));
  CHECK(dirty.at(-15).intensity == Approx(clean.at(-15).intensity).epsilon(0.01));
}

TEST_CASE("stray light pulls a dark board towards a bright one beside it") {
  sim::World world = world_of({{"dark", 1600, -400, 1600, 0, 0.05}, {"bright", 1500, 0, 1500, 400, 1}});
  world.receiver.timing = "fraction";
  const double clean = record(narrow(world, 5), 200).at(-1.5).mean();
  world.receiver.stray = 0.01;
  world.receiver.stray_width_rad = 0.02;
  CHECK(record(narrow(world, 5), 200).at(-1.5).mean() - clean < -2);
}

TEST_CASE("stray light that comes long after an echo changes nothing of it") {
  const std::vector<Board> both{{"near", 900, -500, 2600, 0, 0.5}, {"far", 6000, 0, 6000, 900, 1}};
  for (const char* timing : {"fraction", "threshold"}) {
    const auto seen = [timing](const std::vector<Board>& boards) {
      sim::World world = world_of(boards);
      world.receiver.timing = timing;
      world.receiver.stray = 0.003;
      world.receiver.stray_width_rad = 0.02;
      return record(narrow(world, 5), 200);
    };
    const Recording alone = seen({both.front()}), beside = seen(both);
    for (double beam = -4; beam < -0.8; beam += 0.25) {
      INFO(timing << ", beam " << beam);
      CHECK(beside.at(beam).mean() == Approx(alone.at(beam).mean()).margin(0.2));
      CHECK(beside.at(beam).intensity == Approx(alone.at(beam).intensity).epsilon(0.003));
    }
  }
}

TEST_CASE("a warming device drifts by the sum of its two exponentials") {
  sim::World world = narrow(wall_at(2000), 1);
  world.heat.rise_fast_k = 8;
  world.heat.rise_slow_k = 6;
  world.heat.delay_ps_per_k = 10;
  const auto engine = sim::make_causal_engine(world, 1);
  const auto at = [&](double time) {
    return record_steps(*engine, world.bench.lidar, 300, time).at(0).mean();
  };
  const double cold = at(0);
  for (const double time : {300., 1200., 6000.}) {
    const double kelvin = 8 * (1 - std::exp(-time / 300)) + 6 * (1 - std::exp(-time / 1500));
    CHECK(at(time) - cold == Approx(half_light * 1e-2 * kelvin).margin(0.5));
  }
}

TEST_CASE("a device that is switched off and on warms up again") {
  sim::World world = narrow(wall_at(2000), 1);
  world.heat.rise_fast_k = 8;
  world.heat.delay_ps_per_k = 10;
  const auto engine = sim::make_causal_engine(world, 1);
  const auto at = [&](double time) {
    return record_steps(*engine, world.bench.lidar, 200, time).at(0).mean();
  };
  const double cold = at(0), warm = at(9000);
  REQUIRE(warm - cold > 5);
  engine->switched_on(10000);
  CHECK(at(10000) == Approx(cold).margin(0.5));
  CHECK(at(19000) == Approx(warm).margin(0.5));
}

TEST_CASE("in a warmer room the device follows slowly") {
  sim::World world = narrow(wall_at(2000), 1);
  world.heat.delay_ps_per_k = 10;
  const auto engine = sim::make_causal_engine(world, 1);
  const auto at = [&](double time) {
    return record_steps(*engine, world.bench.lidar, 200, time).at(0).mean();
  };
  const double before = at(0);
  sim::SceneState hot;
  hot.temperature_c = 35;
  engine->set_scene(hot);
  const double half = at(world.heat.slow_s), full = at(20 * world.heat.slow_s);
  CHECK(full - before == Approx(15).margin(0.5));
  CHECK(half - before == Approx(15 * (1 - std::exp(-1))).margin(0.5));
  // An operator who holds it there waits; the scans' clock does not.
  hot.temperature_c = 25;
  hot.held_s = 20 * world.heat.slow_s;
  engine->set_scene(hot);
  CHECK(at(20 * world.heat.slow_s + 1) == Approx(before).margin(0.5));
}

TEST_CASE("a code disk off its axis bends angles by its offset, once a turn") {
  for (const double phase : {0.0, 1.2}) {
    sim::World world = narrow(slanted(2000, 50), 30);
    const Recording exact = record(world, 300);
    world.rotor.disk_offset = 0.004;
    world.rotor.disk_phase_rad = phase;
    const Recording bent = record(world, 300);
    for (const double beam : {-25., 0., 20.}) {
      const double a = beam * fit::rad_per_deg, error = 0.004 * std::sin(a + phase);
      const double expected = along_slant(2000, 50, a + error) - along_slant(2000, 50, a);
      CHECK(bent.at(beam).mean() - exact.at(beam).mean() ==
            Approx(expected).margin(0.5 + 0.01 * std::abs(expected)));
    }
  }
}

TEST_CASE("a leaning code disk bends angles twice a turn") {
  sim::World world = slanted(2000, 40);
  const Recording exact = record(world, 200);
  world.rotor.disk_lean_rad = 0.12;
  const Recording bent = record(world, 200);
  const double amplitude = 0.12 * 0.12 / 4;  // tan^2(lean / 2)
  for (const double beam : {-45., 30.}) {
    const double a = beam * fit::rad_per_deg, error = amplitude * std::sin(2 * a);
    const double expected = along_slant(2000, 40, a + error) - along_slant(2000, 40, a);
    CHECK(std::abs(bent.at(beam).mean() - exact.at(beam).mean()) ==
          Approx(std::abs(expected)).margin(0.5 + 0.03 * std::abs(expected)));
  }
}

TEST_CASE("a tilted scan plane lengthens the ranges to plumb walls by one over its cosine") {
  sim::World world = narrow(wall_at(3000), 1);
  const double level = record(world, 300).at(0).mean();
  world.rotor.plane_tilt_rad = 2 * fit::rad_per_deg;
  world.rotor.plane_axis_rad = fit::pi / 2;
  CHECK(record(world, 300).at(0).mean() - level ==
        Approx(3000 * (1 / std::cos(2 * fit::rad_per_deg) - 1)).margin(0.3));
}

TEST_CASE("an uncertain index pulse moves whole scans, and is seen on slanted walls only") {
  sim::World world = narrow(slanted(2000, 50));
  world.rotor.index_jitter_rad = 1e-3;
  const Recording slant = record(world, 1000);
  CHECK(slant.at(0).sd() == Approx(2000 * std::tan(50 * fit::rad_per_deg) * 1e-3).epsilon(0.12));
  CHECK(correlation(slant.at(0).ranges, slant.at(-10).ranges) > 0.8);
  sim::World square = narrow(wall_at(2000), 1);
  square.rotor.index_jitter_rad = 1e-3;
  CHECK(record(square, 500).at(0).sd() < 1);
}

TEST_CASE("faces of a mirror repeat with their number") {
  sim::World world = narrow(wall_at(2000), 1);
  world.rotor.facets = {{3, 0}, {-3, 0}, {0, 0}};
  const Recording recording = record(world, 300);
  const std::vector<double>& r = recording.at(0).ranges;
  double first = 0, second = 0;
  for (std::size_t i = 0; i + 2 < r.size(); i += 3) {
    first += r[i] / 100;
    second += r[i + 1] / 100;
  }
  CHECK(first - second == Approx(6).margin(0.3));
}

TEST_CASE(
    "noise with memory and a wandering baseline are correlated in time; the latter over the whole scan") {
  sim::World world = narrow(wall_at(2000));
  world.receiver.noise = 5e-4;
  CHECK(std::abs(lag_one(record(world, 1000).at(0).ranges)) < 0.12);
  world.receiver.memory = 0.9;
  const Recording remembered = record(world, 2000);
  CHECK(lag_one(remembered.at(0).ranges) == Approx(0.9).margin(0.06));
  CHECK(std::abs(correlation(remembered.at(0).ranges, remembered.at(5).ranges)) < 0.35);
  world.receiver.memory = 0;
  world.receiver.noise = 1e-4;
  world.receiver.wander = 5e-4;
  const Recording wandering = record(world, 1000);
  CHECK(lag_one(wandering.at(0).ranges) > 0.7);
  CHECK(correlation(wandering.at(0).ranges, wandering.at(5).ranges) > 0.8);
}

TEST_CASE("sunlight makes noise at its beams and its hours") {
  sim::World world = narrow(wall_at(2000));
  world.light.suns = {{10 * fit::rad_per_deg, 0.08, 1e-3, 100, 200}};
  const Recording night = record(world, 300, 0), day = record(world, 300, 110);
  CHECK(day.at(10).sd() > 4 * night.at(10).sd());
  CHECK(day.at(-15).sd() == Approx(night.at(-15).sd()).epsilon(0.2));
}

TEST_CASE("grains of dust answer before the target, as often as the way is long") {
  sim::World world = narrow(wall_at(4000), 20);
  world.air.dust_per_m = 0.01;
  int early = 0, all = 0;
  const Recording recording = record(world, 200);
  for (const Cell& cell : recording.cells) {
    for (const double r : cell.ranges) early += r < 3950, ++all;
  }
  const double expected = 1 - std::exp(-0.01 * 4.1);
  CHECK(early > 0.3 * expected * all);  // far grains are too weak to be seen
  CHECK(early < 1.05 * expected * all);
}

TEST_CASE("a median over beams makes neighbours alike and takes single grains away") {
  sim::World world = narrow(wall_at(2000));
  world.firmware.median = 5;
  world.receiver.noise = 5e-4;
  const Recording smooth = record(world, 500);
  CHECK(correlation(smooth.at(0).ranges, smooth.at(0.25).ranges) > 0.4);
}

}  // namespace causal_device_test
