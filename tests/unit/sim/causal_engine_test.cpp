// SPDX-License-Identifier: MIT
// Each effect emerges from its cause: observables against closed forms, scaling laws and limits that the
// engine itself does not contain.
#include <algorithm>
#include <catch2/catch.hpp>

#include "causal_support.hpp"

using namespace causal_test;
using Catch::Detail::Approx;

namespace {

constexpr double half_light = 149.896229;  // mm per ns, there and back

/// Echo of a board square on: inverse square and overlap.
double echo(const sim::World& world, double range, double reflectance) {
  const double near = world.receiver.overlap_mm;
  const double overlap = std::pow(range * range / (range * range + near * near), 2);
  return reflectance * overlap * 1e6 / (range * range);
}

double bias(sim::World world, double distance, int scans = 300) {
  return record(narrow(std::move(world), 1), scans).at(0).mean() - distance;
}

double correlation(const std::vector<double>& x, const std::vector<double>& y) {
  double mx = 0, my = 0, xy = 0, xx = 0, yy = 0;
  const auto n = static_cast<double>(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) mx += x[i] / n, my += y[i] / n;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xy += (x[i] - mx) * (y[i] - my);
    xx += (x[i] - mx) * (x[i] - mx);
    yy += (y[i] - my) * (y[i] - my);
  }
  return xy / std::sqrt(xx * yy);
}

/// Range at which a beam of that bearing meets the line of a wall seen at `incidence_deg` at 0.
double along_slant(double distance, double incidence_deg, double bearing_rad) {
  const double i = incidence_deg * fit::rad_per_deg;
  return distance * std::cos(i) / std::cos(i + bearing_rad);
}

}  // namespace

// ---- echo strength
// -------------------------------------------------------------------------------------------

TEST_CASE("a good device is right within a millimetre whatever the target") {
  for (const double distance : {500., 2000., 5000.}) {
    for (const double reflectance : {1., 0.3})
      CHECK(std::abs(bias(wall_at(distance, reflectance), distance)) < 1);
  }
}

TEST_CASE("without noise and footprint a good device tells the geometry to a hundredth of a millimetre") {
  sim::World world = narrow(slanted(2500, 20, 0.6), 60);
  world.receiver.noise = 0;
  world.beam.long_rad = world.beam.short_rad = 2e-5;
  world.beam.aperture_mm = 0.02;
  std::vector<double> exact;
  const auto engine = sim::make_causal_engine(world, 1, &exact);
  std::vector<std::uint32_t> range(exact.size()), intensity;
  range.resize(static_cast<std::size_t>(world.bench.lidar.steps));
  intensity.resize(range.size());
  engine->scan(
      0, [](double) { return sim::StageMoment{}; }, range, intensity);
  double worst = 0;
  for (std::size_t k = 0; k < exact.size(); ++k) {
    const double bearing = world.bench.lidar.beam_angle(static_cast<double>(k));
    if (!std::isnan(exact[k])) worst = std::max(worst, std::abs(exact[k] - along_slant(2500, 20, bearing)));
  }
  CHECK(worst < 0.01);
}

TEST_CASE("on a fixed threshold weak echoes read long, as the flank of a Gaussian pulse says") {
  const auto at = [](double reflectance) {
    sim::World world = wall_at(1500, reflectance);
    world.receiver.compensation = 0;
    return bias(world, 1500);
  };
  const sim::World world = wall_at(1500);
  const auto crossing = [&](double reflectance) {
    const double over = echo(world, 1500, reflectance) / world.receiver.threshold;
    return -half_light * world.pulse.rise_ns * std::sqrt(2 * std::log(over));
  };
  CHECK(at(0.1) - at(1.0) == Approx(crossing(0.1) - crossing(1.0)).margin(0.4));
  CHECK(at(0.3) - at(1.0) == Approx(crossing(0.3) - crossing(1.0)).margin(0.4));
  CHECK(at(0.1) > at(0.3));
}

TEST_CASE("a trigger at a constant fraction does not walk") {
  const auto at = [](double reflectance) {
    sim::World world = wall_at(1500, reflectance);
    world.receiver.compensation = 0;
    world.receiver.timing = "fraction";
    return bias(world, 1500);
  };
  CHECK(std::abs(at(0.1) - at(1.0)) < 0.5);
}

TEST_CASE("the noise of the range is electronic noise over the slope of the flank") {
  for (const double reflectance : {1.0, 0.2}) {
    sim::World world = narrow(wall_at(2000, reflectance), 1);
    world.receiver.compensation = 0;
    world.receiver.noise = 2.5e-4;
    const double over = echo(world, 2000, reflectance) / world.receiver.threshold;
    const double slope = world.receiver.threshold * std::sqrt(2 * std::log(over)) / world.pulse.rise_ns;
    CHECK(record(world, 2000).at(0).sd() == Approx(half_light * world.receiver.noise / slope).epsilon(0.1));
  }
}

TEST_CASE("echoes are lost where their power falls below the threshold, with the root of the reflectance") {
  for (const double reflectance : {1.0, 0.1}) {
    sim::World world = wall_at(1000);
    const double limit = 1000 * std::sqrt(reflectance / world.receiver.threshold);
    const auto lost = [&](double range) {
      return record(narrow(wall_at(range, reflectance), 1), 100).at(0).lost;
    };
    CHECK(lost(0.97 * limit) == 0);
    CHECK(lost(1.03 * limit) == 100);
  }
}

TEST_CASE("a clipped echo reads short, because its strength is not seen any more") {
  const auto at = [](double reflectance) {
    sim::World world = wall_at(400, reflectance);
    world.receiver.clip = 1;
    return bias(world, 400);
  };
  const sim::World world = wall_at(400);
  const auto flank = [&](double peak) { return std::sqrt(2 * std::log(peak / world.receiver.threshold)); };
  const double expected = half_light * world.pulse.rise_ns * (flank(1) - flank(echo(world, 400, 1.0)));
  CHECK(at(1.0) == Approx(expected).epsilon(0.05));
  CHECK(std::abs(at(0.05)) < 1);
}

TEST_CASE("intensity falls with range and incidence and bends over near the top") {
  const auto counts = [](const sim::World& world) { return record(narrow(world, 1), 20).at(0).intensity; };
  // A square-root receiver: counts fall as 1/r far away.
  CHECK(counts(wall_at(4000)) / counts(wall_at(8000)) == Approx(2).epsilon(0.06));
  CHECK(counts(slanted(4000, 60)) / counts(wall_at(4000)) == Approx(std::sqrt(0.5)).epsilon(0.06));
  CHECK(counts(wall_at(200)) < 2 * counts(wall_at(400)));
}

// ---- footprint
// -----------------------------------------------------------------------------------------------

TEST_CASE(
    "a slanted wall stretches the pulse, so the fraction is reached early, with the square of the tangent") {
  const auto at = [](double incidence) {
    sim::World world = slanted(5000, incidence);
    world.beam.long_rad = 16e-3;
    world.receiver.timing = "fraction";
    return bias(world, 5000, 600);
  };
  // Pulse and footprint as Gaussians whose variances add; half of the peak is 1.177 standard deviations
  // early.
  const auto expected = [](double incidence) {
    const double pulse = 2 * half_light;
    const double spread = 5000 * std::tan(incidence * fit::rad_per_deg) * 4e-3;
    return -1.177 * (std::hypot(pulse, spread) - pulse);
  };
  for (const double incidence : {60., 70.}) CHECK(at(incidence) == Approx(expected(incidence)).epsilon(0.25));
  CHECK(at(70) / at(60) == Approx(std::pow(std::tan(70 * fit::rad_per_deg), 2) / 3).epsilon(0.25));
}

TEST_CASE("an edge with a gap below the pulse's length gives ranges in between, above it front or back") {
  const auto around_edge = [](double gap) {
    sim::World world =
        world_of({{"front", 1500, -400, 1500, 1}, {"back", 1500 + gap, -900, 1500 + gap, 900}});
    world.receiver.echo = "strongest";
    world.beam.long_rad = 16e-3;
    std::vector<double> seen;
    const Recording recording = record(narrow(world, 3), 60);
    for (const Cell& cell : recording.cells) seen.push_back(cell.mean());
    return seen;
  };
  const auto between = [](const std::vector<double>& seen, double front, double back) {
    return std::ranges::count_if(
        seen, [&](double r) { return r > front + 0.1 * (back - front) && r < back - 0.1 * (back - front); });
  };
  CHECK(between(around_edge(60), 1500, 1560) >= 2);
  CHECK(between(around_edge(1500), 1500, 3000) <= 1);  // at most the beam whose halves are equal
}

TEST_CASE("the footprint turns with the beam: an edge is sharper at the side than in front") {
  const auto mixed = [](bool side) {
    const sim::World front = world_of({{"near", 1500, -400, 1500, 2}, {"far", 1560, -900, 1560, 900}});
    sim::World world = front;
    if (side) {
      for (fit::Target& target : world.bench.targets) {
        for (Eigen::Vector2d* end : {&target.from_mm, &target.to_mm})
          *end = Eigen::Vector2d(-end->y(), end->x());
      }
    }
    world.beam.long_rad = 16e-3;
    world.beam.short_rad = 1e-3;
    const Recording recording = record(world, 60);
    int count = 0;
    for (double beam = -3; beam <= 3; beam += 0.25) {
      const double r = recording.at(beam + (side ? 90 : 0)).mean() * std::cos(beam * fit::rad_per_deg);
      count += r > 1503 && r < 1557;
    }
    return count;
  };
  CHECK(mixed(false) >= 3);
  CHECK(mixed(true) <= 1);
}

TEST_CASE("near an inner corner of glossy walls light comes late by way of the other wall") {
  sim::World world = world_of({{"one", 2000, -1500, 2000, 800, 0.8}, {"two", 2000, 800, -500, 800, 0.8}});
  const auto seen = [&](double gloss, double beam) {
    world.targets["one"].gloss = gloss;
    world.targets["two"].gloss = gloss;
    return record(narrow(world, 40), 200).at(beam).mean();
  };
  const double close = seen(0.4, 21) - seen(0, 21), away = seen(0.4, 2) - seen(0, 2);
  CHECK(close > 1);
  CHECK(std::abs(away) < close / 2);
}

TEST_CASE("light from inside a translucent target comes late, by less than its depth") {
  sim::World world = wall_at(1500);
  world.receiver.timing = "fraction";
  const double opaque = bias(world, 1500);
  world.targets["wall"].depth_mm = 5;
  const double thin = bias(world, 1500) - opaque;
  world.targets["wall"].depth_mm = 20;
  const double thick = bias(world, 1500) - opaque;
  CHECK(thin == Approx(5).margin(1));
  CHECK(thick > 10);
  CHECK(thick < 20.5);
}

TEST_CASE("stripes of other print are seen in the intensity") {
  sim::World world = wall_at(1500, 0.9);
  world.targets["wall"].stripes = {{-100, 100, 0.1}};
  const Recording recording = record(narrow(world, 10), 20);
  CHECK(recording.at(0).intensity < 0.6 * recording.at(8).intensity);
}

TEST_CASE("a shiny board is brighter square on only") {
  sim::World world = wall_at(1500, 0.3);
  const Recording dull = record(narrow(world), 20);
  world.targets["wall"].specular = 10;
  world.targets["wall"].specular_width_rad = 0.05;
  const Recording shiny = record(narrow(world), 20);
  CHECK(shiny.at(0).intensity > 1.7 * dull.at(0).intensity);
  CHECK(shiny.at(15).intensity == Approx(dull.at(15).intensity).epsilon(0.01));
}

TEST_CASE("targets stand where the truth says, tilted and bent") {
  sim::World world = narrow(wall_at(2000));
  world.targets["wall"].offset_mm = 7;
  CHECK(record(world, 200).at(0).mean() - 2000 == Approx(7).margin(0.3));
  world.targets["wall"] = {};
  world.targets["wall"].tilt_rad = 0.01;
  const Recording tilted = record(world, 200);
  // Turned counter-clockwise about its middle, the left half comes nearer.
  CHECK(tilted.at(10).mean() * std::cos(10 * fit::rad_per_deg) - 2000 ==
        Approx(-0.01 * 2000 * std::tan(10 * fit::rad_per_deg)).margin(0.5));
  world.targets["wall"] = {};
  world.targets["wall"].sagitta_mm = 10;
  CHECK(record(world, 200).at(0).mean() - 2000 == Approx(10).margin(0.5));
}

// ---- inside the device
// ---------------------------------------------------------------------------------------

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
}

// ---- mirror and code disk
// ------------------------------------------------------------------------------------

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

// ---- stage
// ---------------------------------------------------------------------------------------------------

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

// ---- order
// ---------------------------------------------------------------------------------------------------

TEST_CASE("the same seed gives the same scans, another one others") {
  const sim::World world = narrow(wall_at(2000, 0.5));
  CHECK(record(world, 5, 0, 7).at(3).ranges == record(world, 5, 0, 7).at(3).ranges);
  CHECK(record(world, 5, 0, 7).at(3).ranges != record(world, 5, 0, 8).at(3).ranges);
}
