// SPDX-License-Identifier: MIT
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "fit/explain/explanation.hpp"
#include "noise_findings.hpp"
#include "plain_scenes.hpp"
#include "synthetic_recording.hpp"
#include "tests/support/rounds.hpp"

namespace explain_strays_test {
namespace {

/// What is said of a wall 1.5 m away that captures of so many scans look at. `range_mm`: of a sample, by
/// where the wall is and by noise; 0: no echo.
template <class Range>
NoiseFindings wall_of(int scans, unsigned seed, const Range& range_mm) {
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 101, "front_step": 50,
    "step_deg": 0.5, "scan_hz": 40}, "targets": [{"name": "wall", "from_mm": [1500, -4000], "to_mm": [1500, 4000],
    "u_mm": 1}], "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 10, "u": 0.2}}}]})");
  std::mt19937 random(seed);
  SyntheticRecording wall(bench, [&](const fit::CaptureInfo&, std::int64_t, std::vector<std::uint16_t>& range,
                                     std::vector<std::uint16_t>& intensity) {
    std::normal_distribution<double> noise(0, 10);
    std::uniform_real_distribution<double> share;
    for (std::size_t k = 0; k < range.size(); ++k) {
      const double far = 1500 / std::cos((static_cast<double>(k) - 50) * 0.5 * fit::rad_per_deg);
      range[k] = static_cast<std::uint16_t>(std::lround(range_mm(
          far, [&] { return noise(random); }, [&] { return share(random); })));
      intensity[k] = 500;
    }
  });
  fit::CaptureInfo capture;
  capture.last_step = 100;
  for (int i = 0; i < 3; ++i) wall.add(capture, scans);
  return NoiseFindings(wall);
}

/// Its samples are dust between lidar and wall now and then, or nothing.
NoiseFindings dusty_wall(double fraction, unsigned seed, double lost = 0) {
  return wall_of(100, seed, [=](double far, const auto& noise, const auto& share) {
    const double at = share() < fraction ? 60 + share() * (far - 60) : far + noise();
    return lost > 0 && share() < lost ? 0 : at;
  });
}

/// More of them than any receiver has lie off: up to `off_mm` nearer or farther, but no nearer than noise
/// reaches.
constexpr double strays = 3e-4;
NoiseFindings wall_with_few_strays(double off_mm, unsigned seed) {
  return wall_of(1000, seed, [=](double far, const auto& noise, const auto& share) {
    const double off = noise();
    return far + (share() < strays ? (share() < 0.5 ? -1 : 1) * (130 + share() * (off_mm - 130)) : off);
  });
}

}  // namespace

TEST_CASE("the fraction of outliers counts those that noise hides, and its uncertainty covers", "[rounds]") {
  constexpr double truth = 0.01;
  int covered = 0, undecided = 0, all = 0;
  double sum = 0;
  for (unsigned seed = 1; seed <= rounds(60); ++seed, ++all) {
    const NoiseFindings result = dusty_wall(truth, seed);
    INFO("seed " << seed << ": " << result.in_words());
    if (result.accepted.empty()) {  // three of a hundred may look like a tail
      ++undecided;
      CHECK(result.undecided.size() == 1);
      continue;
    }
    REQUIRE(result.accepted.size() == 1);
    REQUIRE(result.accepted.front().mechanism->id == "outliers");
    const auto& parameters = result.accepted.front().parameters;
    const fit::Estimate fraction = parameters.at("fraction");
    // That at 2 m, of a wall at 1.5 to 1.65 m.
    const auto power = parameters.find("with_range");  // not there: as often from near as from far
    const double there = power == parameters.end() ? 1 : std::pow(1550 / 2000.0, power->second.value);
    sum += fraction.value * there;
    covered += std::abs(fraction.value * there - truth) < 1.96 * fraction.u * there;
  }
  CHECK(all - undecided >= least_successes(all, 0.98));
  CHECK(covered + undecided >= least_successes(all, 0.95));
  CHECK(sum / (all - undecided) == Approx(truth).margin(0.0016 / std::sqrt(all)));
}

TEST_CASE("three strays in 10,000 samples are outliers far away, and a tail of the noise close to the wall",
          "[rounds]") {
  for (const unsigned seed : some_of<unsigned>({1, 2, 3})) {
    const NoiseFindings far = wall_with_few_strays(1300, seed);
    INFO(far.in_words());
    REQUIRE(far.accepted.size() == 1);
    CHECK(far.accepted.front().mechanism->id == "outliers");
    CHECK(far.accepted.front().parameters.at("fraction").value == Approx(strays).margin(strays / 2));
    const NoiseFindings close = wall_with_few_strays(240, seed);
    INFO(close.in_words());
    CHECK(std::ranges::none_of(close.accepted,
                               [](const auto& found) { return found.mechanism->id == "outliers"; }));
  }
}

TEST_CASE("dust from which nothing comes back is dust, and echoes that go without it are missing") {
  for (const unsigned seed : {1u, 2u, 3u}) {
    const NoiseFindings few = dusty_wall(0.05, seed, 0.001);
    INFO(few.in_words());
    REQUIRE(few.accepted.size() == 1);
    CHECK(few.accepted.front().mechanism->id == "outliers");
    CHECK(few.unknown.empty());
    const NoiseFindings many = dusty_wall(0.05, seed, 0.01);
    INFO(many.in_words());
    if (many.unknown.empty()) {
      REQUIRE(many.undecided.size() == 1);
      CHECK(std::ranges::count(many.undecided.front(), "unknown-physics") == 1);
    } else {
      CHECK(many.unknown.front().observable == fit::Observable::dropout);
    }
  }
}

TEST_CASE("a few samples that lie anywhere are what real receivers have, and no physics", "[rounds]") {
  struct Case {
    const std::vector<plain_bench::Wall>* walls;
    double fraction;
  };
  for (const Case& one : some_of<Case>({{&plain_bench::l_shaped, 2e-5},
                                        {&plain_bench::furnished, 2e-5},
                                        {&plain_bench::corridor, 2e-5},
                                        {&plain_bench::l_shaped, 1e-4},
                                        {&plain_bench::furnished, 1e-4}}))
    for (const unsigned seed : {3U, 4U}) {
      const plain_bench::PlainScene scene{.walls = *one.walls};
      const auto strays = [&](const plain_bench::Sample& sample, std::mt19937& random) {
        std::uniform_real_distribution<double> share;
        return share(random) < one.fraction ? 60 + 7900 * share(random) : sample.range_mm;
      };
      SyntheticRecording recording = plain_bench::recorded(
          scene, seed, [](double, double, double) { return plain_bench::Deviation{}; }, strays);
      plain_bench::turn_round(recording, scene, 14, 40);
      const fit::explain::Explanation e = fit::explain::explain({&recording}, {});
      INFO(one.fraction << ", seed " << seed << ": " << to_text(e));
      CHECK_FALSE(e.unknown);
      for (const auto& found : e.mechanisms) CHECK(found.mechanism->id == "outliers");
    }
}

}  // namespace explain_strays_test
