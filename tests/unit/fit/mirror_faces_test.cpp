// SPDX-License-Identifier: MIT
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "fit/explain/explanation.hpp"
#include "slanted_room.hpp"
#include "synthetic_recording.hpp"
#include "tests/support/rounds.hpp"

namespace mirror_faces_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;

/// Every face of the mirror reads its own amount too far; the stage comes from both sides. Noise
/// is the same everywhere, or as many times that as there are metres of range, over two.
Explanation explained(const std::vector<double>& faces_mm, unsigned seed, double swing_deg = 0,
                      int scans = 12, bool not_moved_before_first = false, bool noise_grows = false) {
  const fit::Bench bench = slanted_room::bench(R"({"value": 4, "u": 0.4})");
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 4);
  SyntheticRecording recording(
      bench, [&](const fit::CaptureInfo& capture, std::int64_t seq, auto& range, auto&) {
        const auto turn = static_cast<std::size_t>(std::llround(40 * *capture.since_power_on_s) + seq);
        for (std::size_t k = 0; k < range.size(); ++k) {
          const double beam = (static_cast<double>(k) - 135) * degree;
          const double since_s = 0.025 * static_cast<double>(seq) + (beam + 135 * degree) / (14400 * degree);
          const double swings =
              swing_deg * degree * capture.approach * std::exp(-since_s / 0.1) * std::cos(30 * since_s);
          const auto met = plain_bench::look(slanted_room::walls, slanted_room::mount, capture.stage_rad,
                                             beam, {.stage_rad = swings});
          const double times = noise_grows ? met->range_mm / 2000 : 1;
          const double mm = met->range_mm + faces_mm[turn % faces_mm.size()] + times * noise(random);
          range[k] = static_cast<std::uint16_t>(std::lround(mm));
        }
      });
  for (int i = 0; i < 16; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = 45.0 * (i < 8 ? i : 15 - i) * degree;
    capture.approach = i < 8 ? 1 : -1;
    if (i == 0 && not_moved_before_first) capture.approach = 0;
    capture.since_power_on_s = 100 + 20 * i;
    capture.last_step = 270;
    recording.add(capture, scans);
  }
  return fit::explain::explain({&recording}, {});
}

}  // namespace

TEST_CASE("mirror faces are named, and nothing beside them", "[rounds]") {
  const std::vector<double> faces_mm = GENERATE(from_range(
      some_of<std::vector<double>>({{0.5, -0.5},
                                    {0.7, -0.2, -0.5},
                                    {0.6, 0.1, -0.6, -0.1},
                                    {1.2, -1.2},
                                    {0.85, -0.41, -0.02, -0.02, -0.41},  // mostly of a second harmonic
                                    {0.9, 0.4, -0.7, -0.9, 0.3}})));
  for (const unsigned seed : some_of<unsigned>({1, 2})) {
    const Explanation e = explained(faces_mm, seed);
    INFO(faces_mm.size() << " faces, seed " << seed << ": " << to_text(e));
    REQUIRE(e.mechanisms.size() == 1);
    CHECK(e.mechanisms.front().mechanism->id == "facet-wobble");
    CHECK(e.mechanisms.front().parameters.at("facets").value == static_cast<double>(faces_mm.size()));
    CHECK_FALSE(e.unknown);
    CHECK(e.undecided_between.empty());
    CHECK(e.verdict == "explained");
  }
}

TEST_CASE("two or three faces have no harmonics that could be their amplitude") {
  const std::vector<double> faces_mm =
      GENERATE(from_range(std::vector<std::vector<double>>{{0.6, -0.6}, {0.64, -0.64, 0}}));
  const Explanation e = explained(faces_mm, 3);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  const fit::Estimate amplitude = e.mechanisms.front().parameters.at("amplitude_mm");
  const double truth_mm = faces_mm.size() == 2 ? 0.6 : 1.28 / std::sqrt(3.0);  // of the sine through them
  CHECK(std::abs(amplitude.value - truth_mm) < 3 * amplitude.u);
  CHECK(amplitude.u < 0.1 * truth_mm);
}

TEST_CASE("the amplitude of mirror faces is not weighed by the samples that show it", "[long]") {
  const bool noise_grows = GENERATE(false, true);
  const Explanation e = explained({1.8, -1.8}, 5, 0, 60, false, noise_grows);
  INFO(to_text(e));
  const auto faces =
      std::ranges::find(e.mechanisms, "facet-wobble", [](const auto& found) { return found.mechanism->id; });
  REQUIRE(faces != e.mechanisms.end());
  const fit::Estimate amplitude = faces->parameters.at("amplitude_mm");
  CHECK(std::abs(amplitude.value - 1.8) < 3 * amplitude.u);
  CHECK(amplitude.u < 0.015);
}

TEST_CASE("mirror faces in the only capture before the stage's first move are no vibration") {
  const Explanation e = explained({0.64, -0.64, 0}, 4, 0, 20, true);
  INFO(to_text(e));
  CHECK(e.verdict == "explained");
  CHECK_FALSE(e.unknown);
}

TEST_CASE("a stage that hardly swings any more does not get a name beside mirror faces") {
  const Explanation e = explained({1.2, -1.2}, 3, 0.002);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "facet-wobble");
  CHECK(e.verdict == "explained");
}

TEST_CASE("the ranges of mirror faces are drawn as they are, and what they gain is measured elsewhere") {
  const std::vector<double> faces_mm{0.7, -0.2, -0.5};
  const Explanation e = explained(faces_mm, 5);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK_FALSE(e.mechanisms.front().gain_is_expected);
  CHECK(e.mechanisms.front().log_likelihood_gain > 20);
  CHECK(e.after.log_likelihood > e.before.log_likelihood + 20);
  REQUIRE(e.spread_curves.size() == 1);
  const auto& curve = e.spread_curves.front();
  REQUIRE(curve.recorded.size() == faces_mm.size());
  // Nobody knows which face is the first.
  const auto best = std::ranges::max_element(curve.recorded);
  const auto first = static_cast<std::size_t>(best - curve.recorded.begin());
  for (std::size_t i = 0; i < faces_mm.size(); ++i) {
    const std::size_t at = (first + i) % faces_mm.size();
    CHECK(std::abs(curve.recorded[at] - faces_mm[i]) < 4 * curve.sigma[at]);
  }
}

TEST_CASE("a stage that swings much is nothing beside it, and drawn along the time since it moved") {
  constexpr double swing_deg = 0.08;
  const Explanation e = explained({0}, 4, swing_deg);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "settling");
  CHECK(e.verdict == "explained");
  CHECK_FALSE(e.mechanisms.front().gain_is_expected);
  REQUIRE(e.spread_curves.size() == 1);
  const auto& curve = e.spread_curves.front();
  CHECK(curve.unit == "deg");
  // From its mean over a capture of 0.3 s; a point stands for a stretch of time.
  for (std::size_t i = 0; i < curve.at.size(); ++i) {
    const double swings = swing_deg * std::exp(-curve.at[i] / 0.1) * std::cos(30 * curve.at[i]);
    CHECK(std::abs(curve.after[i] - swings) < 0.25 * swing_deg);
    CHECK(std::abs(curve.recorded[i] - curve.after[i]) < 5 * curve.sigma[i]);
  }
}

}  // namespace mirror_faces_test
