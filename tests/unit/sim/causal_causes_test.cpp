// SPDX-License-Identifier: MIT
// Causes that the other tests of the causal engine leave out: sign, scaling and limits of each against a
// closed form.
#include <algorithm>
#include <catch2/catch.hpp>

#include "causal_support.hpp"

namespace causal_causes_test {

using namespace causal_test;
using Catch::Detail::Approx;

namespace {

constexpr double deg = fit::rad_per_deg;

/// How far a slanted wall says that a beam was bent, rad.
double bent(const Recording& with, const Recording& without, double beam_deg) {
  const double slope =
      along_slant(2000, 50, beam_deg * deg + 1e-4) - along_slant(2000, 50, beam_deg * deg - 1e-4);
  return (with.at(beam_deg).mean() - without.at(beam_deg).mean()) / slope * 2e-4;
}

/// Slope of the Gaussian flank where a threshold meets it: d(peak fraction)/dt, per ns (Abshire et al., Appl.
/// Opt. 39 (2000) 2449: timing noise is amplitude noise over the slope).
double slope_at_threshold(const sim::World& world, double peak) {
  const double x = std::sqrt(2 * std::log(peak / world.receiver.threshold));
  return world.receiver.threshold * x / world.pulse.rise_ns;
}

}  // namespace

TEST_CASE("jitter of the counter is noise of the range whatever the echo, and may remember the scan before") {
  sim::World world = narrow(wall_at(2000), 1);
  world.counter.jitter_ns = 0.04;
  const Recording near = record(world, 2000);
  CHECK(near.at(0).sd() == Approx(0.04 * half_light).epsilon(0.06));
  CHECK(std::abs(lag_one(near.at(0).ranges)) < 0.08);
  sim::World weak = narrow(wall_at(2000, 0.1), 1);
  weak.counter.jitter_ns = 0.04;
  CHECK(record(weak, 2000).at(0).sd() == Approx(near.at(0).sd()).epsilon(0.06));
  world.counter.jitter_memory =
      0.8;  // AR(1): the variance stays (Box and Jenkins, Time Series Analysis, 3.2)
  const Recording remembered = record(world, 4000);
  CHECK(remembered.at(0).sd() == Approx(0.04 * half_light).epsilon(0.12));
  CHECK(lag_one(remembered.at(0).ranges) == Approx(0.8).margin(0.06));
}

TEST_CASE("a motor that is fast between two index pulses stretches the angles, both ways from the front") {
  sim::World world = narrow(slanted(2000, 50), 20);
  const Recording exact = record(world, 200);
  world.rotor.speed_error = 0.005;
  const Recording fast = record(world, 200);
  CHECK(bent(fast, exact, 16) == Approx(0.005 * 16 * deg).epsilon(0.1));
  CHECK(bent(fast, exact, -16) == Approx(-0.005 * 16 * deg).epsilon(0.1));
  CHECK(std::abs(bent(fast, exact, 0)) < 1e-4);
}

TEST_CASE("behind a lost slit all angles are off by one slit, before it none") {
  sim::World world = narrow(slanted(2000, 50), 20);
  const Recording exact = record(world, 200);
  world.rotor.lost_slit_rad = 0.2 * deg;
  world.rotor.lost_slit_at_rad = 5 * deg;
  const Recording off = record(world, 200);
  CHECK(bent(off, exact, 12) == Approx(0.2 * deg).epsilon(0.05));
  CHECK(bent(off, exact, 6) == Approx(0.2 * deg).epsilon(0.05));
  CHECK(std::abs(bent(off, exact, 4)) < 1e-4);
}

TEST_CASE("interpolation between slits errs as a sawtooth, cogging as a sine of its order") {
  sim::World world = narrow(slanted(2000, 50), 20);
  const Recording exact = record(world, 200);
  world.rotor.interpolation_rad = 2e-3;
  world.rotor.slits = 36;  // one every 10 deg
  const Recording saw = record(world, 200);
  CHECK(bent(saw, exact, 2.5) == Approx(-1e-3).margin(1e-4));
  CHECK(bent(saw, exact, 7.5) == Approx(1e-3).margin(1e-4));
  CHECK(bent(saw, exact, 12.5) == Approx(-1e-3).margin(1e-4));
  world.rotor.slits = 0;
  world.rotor.ripple_rad = 2e-3;
  world.rotor.ripple_order = 6;
  const Recording ripple = record(world, 200);
  CHECK(bent(ripple, exact, 15) == Approx(2e-3).margin(1e-4));
  CHECK(bent(ripple, exact, -15) == Approx(-2e-3).margin(1e-4));
  CHECK(bent(ripple, exact, 5) == Approx(1e-3).margin(1e-4));
}

TEST_CASE("a mirror's faces may point aside, scan by scan") {
  sim::World world = narrow(slanted(2000, 50), 1);
  world.rotor.facets = {{0, 1e-3}, {0, -1e-3}};
  const Recording recording = record(world, 400);
  double sum = 0;
  for (std::size_t i = 0; i < 400; i += 2) sum += recording.at(0).ranges[i] - recording.at(0).ranges[i + 1];
  const double expected = along_slant(2000, 50, 1e-3) - along_slant(2000, 50, -1e-3);
  CHECK(sum / 200 == Approx(expected).margin(0.3));
}

TEST_CASE(
    "a wall out of plumb is farther where the beam rises, nearer where it falls, and the same in a level "
    "plane") {
  sim::World world = narrow(wall_at(3000), 1);
  const auto mean = [&](double axis_deg, double tilt_deg, double plumb_deg) {
    sim::World one = world;
    one.rotor.plane_tilt_rad = tilt_deg * deg;
    one.rotor.plane_axis_rad = axis_deg * deg;
    one.targets["wall"].plumb_rad = plumb_deg * deg;
    return record(one, 300).at(0).mean();
  };
  const double lift = std::sin(1 * deg) * 3000 * std::tan(2 * deg);
  CHECK(mean(-90, 1, 2) - mean(-90, 1, 0) == Approx(lift).margin(0.2));
  CHECK(mean(90, 1, 2) - mean(90, 1, 0) == Approx(-lift).margin(0.2));
  CHECK(mean(90, 0, 2) - mean(90, 0, 0) == Approx(0).margin(0.1));
}

TEST_CASE("a table that leans on its axis lifts the beams across its tilt") {
  sim::World world = narrow(wall_at(3000), 1);
  const double level = record(world, 300).at(0).mean();
  world.stage.wobble_rad = 2 * deg;
  world.stage.wobble_phase_rad = -90 * deg;
  CHECK(record(world, 300).at(0).mean() - level == Approx(3000 * (1 / std::cos(2 * deg) - 1)).margin(0.3));
  world.stage.wobble_phase_rad = 0;
  CHECK(record(world, 300).at(0).mean() - level == Approx(0).margin(0.2));
}

TEST_CASE("shot noise works like electronic noise of its size at the comparator") {
  sim::World world = narrow(wall_at(2000), 1);
  world.receiver.noise = 0;
  world.receiver.photon_noise = 5e-4 / std::sqrt(world.receiver.threshold);
  const double expected = 5e-4 / slope_at_threshold(world, echo(world, 2000, 1)) * half_light;
  CHECK(record(world, 2000).at(0).sd() == Approx(std::hypot(expected, 0.29)).epsilon(0.08));
}

TEST_CASE("a warm receiver loses gain, and with it intensity by its power law") {
  sim::World world = narrow(wall_at(3000), 1);
  world.heat.gain_per_k = 0.01;
  world.heat.reference_c = 25;
  const double cold = record(world, 20).at(0).intensity;
  world.heat.rise_fast_k = 20;
  world.heat.fast_s = 1;
  const double warm = record(world, 20, 1000).at(0).intensity;
  CHECK(warm / cold == Approx(std::sqrt(1 - 0.2)).epsilon(0.05));
}

TEST_CASE("a lamp shakes the ranges with its own frequency") {
  sim::World world = narrow(wall_at(2000), 1);
  world.rotor.rolling = false;
  world.light.lamp = 5e-4;
  world.light.lamp_hz = 10;  // four scans
  const std::vector<double> r = record(world, 400).at(0).ranges;
  double swing = 0, other = 0;
  for (std::size_t i = 0; i < r.size(); i += 4) {
    swing += (r[i + 3] - r[i + 1]) / 2;
    other += (r[i + 2] - r[i]) / 2;
  }
  const double n = static_cast<double>(r.size()) / 4;
  const double expected = 5e-4 / slope_at_threshold(world, echo(world, 2000, 1)) * half_light;
  CHECK(std::abs(swing / n) == Approx(expected).epsilon(0.12));
  CHECK(std::abs(other / n) < 0.3);
}

TEST_CASE("a stage's scale grows with its angle, and meshing adds the worm's second harmonic") {
  sim::World world = narrow(slanted(2000, 50), 1);
  const auto seen = [&](double drive) {
    const auto engine = sim::make_causal_engine(world, 1);
    const double r = record_steps(*engine, world.bench.lidar, 200, 10,
                                  [&](double) {
                                    return sim::StageMoment{drive, 0};
                                  })
                         .at(0)
                         .mean();
    return std::acos(2000 * std::cos(50 * deg) / r) - 50 * deg;
  };
  world.stage.scale = 0.01;
  CHECK(seen(10 * deg) - 10 * deg == Approx(0.1 * deg).margin(1e-4));
  CHECK(seen(-20 * deg) + 20 * deg == Approx(-0.2 * deg).margin(1e-4));
  world.stage.scale = 0;
  world.stage.worm_rad = 2e-3;
  world.stage.worm_teeth = 90;
  world.stage.worm_second = 0.5;
  const double a = 1.5 * deg;
  CHECK(seen(a) - a == Approx(2e-3 * (std::sin(90 * a) + 0.5 * std::sin(180 * a + 1))).margin(1.5e-4));
}

TEST_CASE("pulses that begin at a time cannot walk farther than that, a Gaussian one can") {
  // Walk of a strong echo against one just above the threshold (Amann et al., Opt. Eng. 40 (2001) 10).
  const auto walk = [](const char* shape) {
    sim::World strong = narrow(wall_at(1000), 1), weak = narrow(wall_at(1000, 0.006), 1);
    for (sim::World* world : {&strong, &weak}) {
      world->pulse.shape = shape;
      world->receiver.compensation = 0;
    }
    return record(weak, 100).at(0).mean() - record(strong, 100).at(0).mean();
  };
  CHECK(walk("two-pole") > 50);
  CHECK(walk("two-pole") < 1.5 * 2 * half_light);
  CHECK(walk("raised-cosine") > 50);
  CHECK(walk("raised-cosine") < 2.5 * 2 * half_light);
  CHECK(walk("gaussian") > walk("two-pole"));
}

TEST_CASE("intensity follows its power law and has the peak detector's noise") {
  sim::World world = narrow(wall_at(4000), 1);
  world.receiver.counts_exponent = 0.8;
  world.receiver.counts_noise = 0.05;
  const auto engine = sim::make_causal_engine(world, 3);
  std::vector<std::uint32_t> range(9), intensity(9);
  double sum = 0, squares = 0;
  constexpr int scans = 2000;
  for (int i = 0; i < scans; ++i) {
    engine->scan(
        i * 0.025, [](double) { return sim::StageMoment{}; }, range, intensity);
    sum += intensity[4];
    squares += static_cast<double>(intensity[4]) * intensity[4];
  }
  const double mean = sum / scans;
  const double raw = 900 * std::pow(echo(world, 4000, 1), 0.8);
  CHECK(mean == Approx(raw / std::hypot(1, raw / 2800)).epsilon(0.02));
  CHECK(std::sqrt(squares / scans - mean * mean) / mean == Approx(0.05).epsilon(0.1));
}

TEST_CASE(
    "a beam aside of the mirror's axis meets a slanted wall elsewhere; parallax lengthens near ranges") {
  sim::World world = narrow(slanted(2000, 45), 1);
  const double centred = record(world, 300).at(0).mean();
  world.beam.aside_mm = 5;
  CHECK(record(world, 300).at(0).mean() - centred == Approx(5).margin(0.3));
  sim::World near = narrow(wall_at(300), 1);
  const double coaxial = record(near, 300).at(0).mean();
  near.receiver.parallax_mm = 60;
  CHECK(record(near, 300).at(0).mean() - coaxial == Approx((std::hypot(300, 60) - 300) / 2).margin(0.2));
  sim::World far = narrow(wall_at(6000), 1);
  const double alone = record(far, 300).at(0).mean();
  far.receiver.parallax_mm = 60;
  CHECK(record(far, 300).at(0).mean() - alone == Approx(0.15).margin(0.2));
}

}  // namespace causal_causes_test
