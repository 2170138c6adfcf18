// SPDX-License-Identifier: MIT
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <set>
#include <vector>

#include "fit/explain/explanation.hpp"
#include "fit/explain/reduce.hpp"
#include "fit/explain/spread.hpp"
#include "fit/explain/spread/losses/counts.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/spread/unseen.hpp"
#include "fit/explain/spread/variance_model.hpp"
#include "synthetic_recording.hpp"

namespace {

using fit::explain::spread::Pool;
using fit::explain::spread::VarianceModel;

struct Item {
  int capture, number;
};

/// Of samples on the lit wall, mm^2.
double variance_at(double beam_deg) { return 25 + 9 * std::exp(-0.5 * std::pow((beam_deg - 20) / 10, 2)); }

/// What is said of a wall, 1 m away, on which light falls around beam 20 deg in all five captures. `gain`: by
/// which those samples are likelier under what was drawn than under the same noise everywhere.
fit::explain::SpreadResult spread_of_lit_wall(unsigned seed, double& gain) {
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 121, "front_step": 60,
    "step_deg": 1, "scan_hz": 40}, "targets": [{"name": "wall", "from_mm": [1000, -6000], "to_mm": [1000, 6000],
    "u_mm": 1}], "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 5, "u": 2}}}]})");
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  constexpr int captures = 5, scans = 100;
  constexpr std::size_t beams = 121;
  const auto variance = [](std::size_t k) { return variance_at(static_cast<double>(k) - 60); };
  double mean = 0, squares = 0;
  for (std::size_t k = 0; k < beams; ++k) mean += variance(k) / beams;
  SyntheticRecording wall(bench, [&](const fit::CaptureInfo&, std::int64_t, std::vector<std::uint16_t>& range,
                                     std::vector<std::uint16_t>&) {
    for (std::size_t k = 0; k < beams; ++k) {
      const double beam = (static_cast<double>(k) - 60) * fit::rad_per_deg,
                   off = std::sqrt(variance(k)) * normal(random);
      range[k] = static_cast<std::uint16_t>(std::lround(1000 / std::cos(beam) + off));
      squares += 0.5 * (std::log(mean / variance(k)) + off * off * (1 / mean - 1 / variance(k)));
    }
  });
  for (int i = 0; i < captures; ++i) {
    fit::CaptureInfo capture;
    capture.last_step = static_cast<int>(beams) - 1;
    capture.target = "wall";
    capture.since_power_on_s = 600 + 30 * i;
    wall.add(capture, scans);
  }
  fit::explain::Reduced reduced = fit::explain::reduce(wall, {});
  gain = squares;
  fit::explain::pool_variances(reduced);
  return fit::explain::explain_spread(reduced);
}

}  // namespace

TEST_CASE("what a suspect gains is asked of every capture, of each by a fit to others only") {
  std::vector<Item> items;
  for (int i = 0; i < 70; ++i) items.push_back({i % 7, i});
  std::set<int> asked;
  const auto gain = fit::explain::spread::held_out_gain(
      items,
      [&](const std::vector<Item>& own, const std::vector<Item>& others) {
        CHECK(own.size() + others.size() == items.size());
        for (const Item& one : own) {
          CHECK(asked.insert(one.number).second);
          for (const Item& other : others) CHECK(other.capture != one.capture);
        }
        return static_cast<double>(own.size());
      },
      &Item::capture);
  REQUIRE(gain);
  CHECK(*gain == Approx(items.size()));
  const auto of_one = [](const std::vector<Item>&, const std::vector<Item>&) { return 1.0; };
  CHECK_FALSE(fit::explain::spread::held_out_gain(std::vector<Item>{{3, 0}, {3, 1}}, of_one, &Item::capture));
}

TEST_CASE("a noise that is not there gains where it was fitted, and loses where it was not") {
  double fitted = 0, held_out = 0;
  for (unsigned seed = 1; seed <= 60; ++seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    std::vector<Pool> pools;
    fit::explain::spread::Column nowhere;
    for (int capture = 0; capture < 6; ++capture)
      for (int place = 0; place < 30; ++place) {
        Pool pool;
        pool.capture = capture;
        pool.freedom = 80;
        pool.kurtosis = 3;
        for (int k = 0; k < 80; ++k) pool.variance += 25 * std::pow(normal(random), 2) / 80;
        pools.push_back(pool);
        nowhere.push_back(place % 3 == 0 ? 1 : 0);
      }
    const VarianceModel model(pools, {5, 2}, 0, 1);
    const fit::explain::spread::Parts none, more = none.with(nowhere);
    fitted += model.fit(more).log_likelihood - model.fit(none).log_likelihood;
    const auto gain = model.held_out_gain(none, more);
    REQUIRE(gain);
    held_out += *gain;
  }
  CHECK(fitted > 0);
  CHECK(held_out < 0);
}

TEST_CASE("light on a wall gains in captures that it was not fitted to what it is worth there") {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    double gain = 0;
    const auto result = spread_of_lit_wall(seed, gain);
    // It neither comes and goes nor drowns echoes: noise local in the beam would look the same.
    REQUIRE(result.undecided.size() == 1);
    const auto& light = result.undecided.front().front();
    REQUIRE(light.mechanism);
    CHECK(light.mechanism->id == "sunlight");
    REQUIRE(light.held_out_gain);
    CAPTURE(seed, gain, light.gain, *light.held_out_gain);
    CHECK(*light.held_out_gain < light.gain);
    CHECK(*light.held_out_gain > 0.8 * gain);
    CHECK(*light.held_out_gain < 1.1 * gain);
  }
}

TEST_CASE("the scatter of samples is drawn as it was, and as it is explained") {
  double gain = 0;
  const auto result = spread_of_lit_wall(7, gain);
  REQUIRE(result.curves.size() == 1);
  const fit::explain::SpreadCurve& curve = result.curves.front();
  CHECK(curve.observable == fit::Observable::range_variance);
  CHECK(curve.coordinate == fit::Coordinate::beam);
  REQUIRE(curve.at.size() > 10);
  double off = 0, of_before = 0, of_after = 0;
  for (std::size_t i = 0; i < curve.at.size(); ++i) {
    CHECK(curve.before[i] == Approx(curve.before.front()));
    off += std::pow((curve.recorded[i] - std::sqrt(variance_at(curve.at[i]))) / curve.sigma[i], 2);
    of_before += std::pow((curve.recorded[i] - curve.before[i]) / curve.sigma[i], 2);
    of_after += std::pow((curve.recorded[i] - curve.after[i]) / curve.sigma[i], 2);
  }
  const auto points = static_cast<double>(curve.at.size());
  CHECK(off < points + 4 * std::sqrt(2 * points));
  CHECK(of_after < points + 4 * std::sqrt(2 * points));
  CHECK(of_before > 2 * of_after);
}

TEST_CASE("echoes that are missing are all drawn, the weak ones finely") {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> intensity(20, 1000);
  std::vector<fit::explain::spread::Count> cells;
  for (int i = 0; i < 3000; ++i) {
    const double counts = intensity(random);
    std::binomial_distribution<int> lost(100, 1 / (1 + std::exp((counts - 60) / 6)));
    cells.push_back({counts, 0, static_cast<double>(lost(random)), 100, 0, 0});
  }
  const auto counts = fit::explain::spread::summed(cells);
  const auto curve = fit::explain::spread::losses_along_intensity(
      counts, [](double at) { return 1 / (1 + std::exp((at - 60) / 6)); });
  REQUIRE(curve.at.size() > 10);
  CHECK(std::ranges::is_sorted(curve.at));
  CHECK(std::ranges::count_if(curve.at, [](double at) { return at < 80; }) >= 5);
  for (std::size_t i = 0; i < curve.at.size(); ++i)
    CHECK(std::abs(curve.recorded[i] - curve.after[i]) < 5 * curve.sigma[i]);
}

TEST_CASE("a picture goes when the noise that it shows is not believed any more") {
  using fit::explain::SpreadResult;
  SpreadResult result;
  for (const char* id : {"range-noise", "sunlight"}) {
    fit::explain::Suspect noise = fit::explain::spread::suspected(id);
    noise.gain = id == std::string("sunlight") ? 50 : 5;
    result.accepted.push_back(noise);
    fit::explain::SpreadCurve curve;
    curve.observable = noise.mechanism->observable;
    curve.coordinate = noise.mechanism->coordinate;
    result.curves.push_back(curve);
  }
  fit::explain::SpreadCurve swing;
  swing.observable = fit::Observable::range_mean;
  result.curves.push_back(swing);
  fit::explain::spread::distrust_noise(10, 10, result);
  REQUIRE(result.curves.size() == 2);
  CHECK(result.curves.front().coordinate == fit::Coordinate::beam);
  CHECK(result.curves.back().observable == fit::Observable::range_mean);
}
