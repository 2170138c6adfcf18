// SPDX-License-Identifier: MIT
// Each effect emerges from its cause: observables against closed forms, scaling laws and limits that the
// engine itself does not contain. Strength of echoes, and the footprint of a beam.
#include <algorithm>
#include <catch2/catch.hpp>

#include "causal_support.hpp"

namespace causal_echo_test {

using namespace causal_test;
using Catch::Detail::Approx;

TEST_CASE("a good device is right within a millimetre whatever the target") {
  for (const double distance : {500., 2000., 5000.}) {
    for (const double reflectance : {1., 0.3})
      CHECK(std::abs(bias(wall_at(distance, reflectance), distance)) < 1);
  }
}

namespace {

/// Ranges of all beams, mm, by a device without noise and footprint; NaN where there is no echo.
std::vector<double> exact_ranges(sim::World world) {
  world.receiver.noise = 0;
  world.beam.long_rad = world.beam.short_rad = 2e-5;
  world.beam.aperture_mm = 0.02;
  std::vector<double> exact;
  const auto engine = sim::make_causal_engine(world, 1, &exact);
  std::vector<std::uint32_t> range(static_cast<std::size_t>(world.bench.lidar.steps)),
      intensity(range.size());
  engine->scan(
      0, [](double) { return sim::StageMoment{}; }, range, intensity);
  return exact;
}

}  // namespace

TEST_CASE("without noise and footprint a good device tells the geometry to a hundredth of a millimetre") {
  const sim::World world = narrow(slanted(2500, 20, 0.6), 60);
  const std::vector<double> exact = exact_ranges(world);
  double worst = 0;
  for (std::size_t k = 0; k < exact.size(); ++k) {
    const double bearing = world.bench.lidar.beam_angle(static_cast<double>(k));
    if (!std::isnan(exact[k])) worst = std::max(worst, std::abs(exact[k] - along_slant(2500, 20, bearing)));
  }
  CHECK(worst < 0.01);
}

TEST_CASE("a round target is as far away as its circle is, and hides what is behind") {
  sim::World world = narrow(wall_at(2000));
  fit::Target post;
  post.name = "post";
  post.set_round({{900, 120}, 100});
  world.bench.targets.push_back(post);
  const std::vector<double> exact = exact_ranges(world);
  int met = 0;
  for (std::size_t k = 0; k < exact.size(); ++k) {
    const double bearing = world.bench.lidar.beam_angle(static_cast<double>(k)),
                 passes_mm = std::abs(900 * std::sin(bearing) - 120 * std::cos(bearing));
    INFO("beam at " << bearing * fit::deg_per_rad << " deg");
    if (passes_mm > 100.5) CHECK(exact[k] == Approx(2000 / std::cos(bearing)).margin(0.01));
    if (passes_mm > 90) continue;  // of flat pieces: at a slant their bearings count
    const double half_chord_mm = std::sqrt(100 * 100 - passes_mm * passes_mm);
    CHECK(exact[k] == Approx(900 * std::cos(bearing) + 120 * std::sin(bearing) - half_chord_mm).margin(0.1));
    ++met;
  }
  CHECK(met > 40);
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

TEST_CASE("a post stands aside and is thicker, as the truth says") {
  sim::World world = narrow(wall_at(2000));
  world.bench.targets.front().set_round({.centre_mm = {2000, 0}, .radius_mm = 300});
  const auto front = [&](sim::TargetTruth truth) {
    world.targets["wall"] = truth;
    return record(world, 200).at(0).mean();
  };
  CHECK(front({}) == Approx(1700).margin(0.5));
  CHECK(front({.thicker_mm = 20}) == Approx(1680).margin(0.5));
  CHECK(front({.aside_mm = 120}) == Approx(2000 - std::sqrt(300. * 300 - 120 * 120)).margin(0.6));
  CHECK(front({.offset_mm = 15, .aside_mm = -120}) ==
        Approx(2015 - std::sqrt(300. * 300 - 120 * 120)).margin(0.6));
  // Counter-clockwise of where it was: beams to the left meet it more squarely.
  world.targets["wall"] = {.aside_mm = 120};
  const double bearing = 5 * fit::rad_per_deg, along = 2000 * std::cos(bearing) + 120 * std::sin(bearing),
               beside = -2000 * std::sin(bearing) + 120 * std::cos(bearing);
  CHECK(record(world, 200).at(5).mean() ==
        Approx(along - std::sqrt(300. * 300 - beside * beside)).margin(0.6));
}

}  // namespace causal_echo_test
