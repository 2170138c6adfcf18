// SPDX-License-Identifier: MIT
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "fit/explain/explanation.hpp"
#include "synthetic_recording.hpp"
#include "tests/support/rounds.hpp"

namespace explain_walk_test {
namespace {

using fit::explain::Explanation;

/// A wall, bright and dark, at distances from half a metre to four: how late an echo is measured is a
/// function of its strength (1: white, square on, at 1 m).
Explanation explanation_of_wall(const std::function<double(double echo)>& late_mm, unsigned seed) {
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 101,
    "front_step": 50, "step_deg": 1, "scan_hz": 40}, "targets": [{"name": "wall", "from_mm": [600, -20000],
    "to_mm": [600, 20000], "u_mm": 1, "reflectance": 0.85}],
    "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 4, "u": 0.2}}}]})");
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 4);
  SyntheticRecording recording(
      bench, [&](const fit::CaptureInfo& capture, std::int64_t, std::vector<std::uint16_t>& range,
                 std::vector<std::uint16_t>& intensity) {
        for (std::size_t i = 0; i < range.size(); ++i) {
          const double slant = (static_cast<double>(i) - 50) * fit::rad_per_deg,
                       far = (600 + capture.target_shift_mm) / std::cos(slant),
                       echo = *capture.reflectance * std::cos(slant) * std::pow(1000 / far, 2);
          range[i] = static_cast<std::uint16_t>(std::lround(far + late_mm(echo) + noise(random)));
          intensity[i] = static_cast<std::uint16_t>(std::lround(1200 * std::sqrt(echo)));
        }
      });
  fit::CaptureInfo capture;
  capture.last_step = 100;
  capture.target = "wall";
  for (const double shift_mm : {0., 700., 1900., 3700.})
    for (const double reflectance : {0.85, 0.3, 0.08}) {
      capture.target_shift_mm = shift_mm;
      capture.reflectance = reflectance;
      recording.add(capture, 20);
    }
  return fit::explain::explain({&recording}, {});
}

/// Where a Gaussian pulse of that standard deviation crosses a fixed threshold, before its middle.
double crossing_mm(double echo, double pulse_mm) {
  constexpr double threshold = 0.0005;
  return -pulse_mm * std::sqrt(2 * std::log(echo / threshold));
}

}  // namespace

TEST_CASE("the walk of a pulse that no formula of ours describes is told as a walk", "[rounds]") {
  const auto explained = [](double pulse_mm, unsigned seed) {
    return explanation_of_wall(
        [pulse_mm](double echo) { return crossing_mm(echo, pulse_mm) - crossing_mm(1, pulse_mm); }, seed);
  };
  const auto is_named = [](const Explanation& e) {
    for (const auto& found : e.mechanisms) CHECK(found.mechanism->id == "range-walk");
    return !e.mechanisms.empty();
  };
  int named = 0;
  const std::vector<unsigned> seeds = some_of<unsigned>({1, 2, 3, 4, 5, 6});
  for (const unsigned seed : seeds) {  // Hardly seen: named, or in the set.
    const Explanation e = explained(0.6, seed);
    INFO("seed " << seed << ": " << to_text(e));
    if (is_named(e)) {
      ++named;
    } else {
      REQUIRE(e.undecided_between.size() == 1);
      CHECK(std::ranges::count(e.undecided_between.front(), "range-walk") == 1);
    }
  }
  CHECK(2 * named >= std::ssize(seeds));
  for (const unsigned seed : some_of<unsigned>({1, 2})) {  // So that any formula's fault is.
    const Explanation e = explained(30, seed);
    INFO("seed " << seed << ": " << to_text(e));
    CHECK(is_named(e));
    for (const auto& set : e.undecided_between) CHECK(std::ranges::count(set, "nothing-missing") == 1);
  }
}

TEST_CASE("a walk that falls off again among the weakest echoes is a walk and nothing beside it") {
  const unsigned seed = GENERATE(1U, 2U);
  const Explanation e = explanation_of_wall(
      [](double echo) {
        const double weakness = 1 / std::sqrt(echo);
        return 600 * (weakness - 1) / (20 + weakness * weakness);
      },
      seed);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "range-walk");
  CHECK(e.undecided_between.empty());
  CHECK_FALSE(e.unknown);
}

TEST_CASE("a place among the echoes at which ranges jump is no walk for certain") {
  const Explanation e = explanation_of_wall([](double echo) { return echo > 0.1 ? 6.0 : 0.0; }, 4);
  INFO(to_text(e));
  CHECK((e.unknown || !e.undecided_between.empty()));
  for (const auto& found : e.mechanisms) CHECK(found.probability <= 0.9);
}

TEST_CASE("a saturation that levels off is one") {
  const unsigned seed = GENERATE(1U, 2U);
  const Explanation e = explanation_of_wall(
      [](double echo) {
        const double over = 1200 * std::sqrt(echo) / 400 - 1;  // counts, above 400
        return over > 0 ? -5 * (1 - std::exp(-over)) : 0.0;
      },
      seed);
  INFO(to_text(e));
  CHECK_FALSE(e.unknown);
  std::vector<std::string> names;
  for (const auto& found : e.mechanisms) names.push_back(found.mechanism->id);
  for (const auto& set : e.undecided_between) names.insert(names.end(), set.begin(), set.end());
  CHECK(std::ranges::count(names, "saturation") == 1);
}

TEST_CASE("an offset and a scale in a ladder of one grey are no walk for certain", "[long]") {
  const double scale = GENERATE(0.003, -0.006);
  const unsigned seed = GENERATE(1U, 2U);
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 9, "front_step": 4,
    "step_deg": 1, "scan_hz": 40}, "targets": [{"name": "board", "from_mm": [400, -300], "to_mm": [400, 300],
    "u_mm": 1, "reflectance": 0.85}],
    "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 4, "u": 0.2}}}]})");
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 4);
  SyntheticRecording recording(
      bench, [&](const fit::CaptureInfo& capture, std::int64_t, std::vector<std::uint16_t>& range,
                 std::vector<std::uint16_t>& intensity) {
        for (std::size_t i = 0; i < range.size(); ++i) {
          const double far =
              (400 + capture.target_shift_mm) / std::cos((static_cast<double>(i) - 4) * fit::rad_per_deg);
          range[i] = static_cast<std::uint16_t>(std::lround(far + 12 + scale * far + noise(random)));
          intensity[i] = static_cast<std::uint16_t>(std::lround(900 * 1000 / far));
        }
      });
  fit::CaptureInfo capture;
  capture.last_step = 8;
  capture.target = "board";
  for (int i = 0; i < 20; ++i) {
    capture.target_shift_mm = 110.0 * i;
    recording.add(capture, 20);
  }
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  for (const auto& found : e.mechanisms)
    CHECK((found.mechanism->id == "range-scale" || found.mechanism->id == "zero-offset"));
  if (e.mechanisms.size() == 2) return;
  REQUIRE_FALSE(e.undecided_between.empty());
  CHECK(std::ranges::any_of(e.undecided_between,
                            [](const auto& set) { return std::ranges::count(set, "range-scale") == 1; }));
}

}  // namespace explain_walk_test
