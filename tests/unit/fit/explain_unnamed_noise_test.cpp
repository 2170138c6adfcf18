// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>
#include <set>
#include <string>
#include <string_view>

#include "fit/explain/inference/screen.hpp"
#include "fit/explain/inference/steps.hpp"
#include "fit/explain/reduction/reduce.hpp"
#include "noise_findings.hpp"
#include "synthetic_recording.hpp"
#include "tests/support/rounds.hpp"

namespace explain_unnamed_noise_test {
namespace {

/// Where a sample falls beside its true range, mm.
using Noise = std::function<double(double beam_rad, double range_mm, std::mt19937& random)>;

/// A look at a wall, 1 to 3 m away, seen by 121 beams, whose bench states 5 mm of noise.
template <class Look>
auto look_at_wall(const Noise& noise, unsigned seed, const Look& look) {
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 121, "front_step": 60,
    "step_deg": 1, "scan_hz": 40}, "targets": [{"name": "wall", "from_mm": [1000, -6000], "to_mm": [1000, 6000],
    "u_mm": 1}], "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 5, "u": 0.25}}}]})");
  std::mt19937 random(seed);
  SyntheticRecording wall(
      bench, [&](const fit::CaptureInfo& info, std::int64_t, std::vector<std::uint16_t>& range,
                 std::vector<std::uint16_t>& intensity) {
        for (std::size_t k = 0; k < range.size(); ++k) {
          const double beam = (static_cast<double>(k) - 60) * fit::rad_per_deg,
                       far = (1000 + info.target_shift_mm) / std::cos(beam);
          range[k] = static_cast<std::uint16_t>(std::lround(far + noise(beam, far, random)));
          intensity[k] = static_cast<std::uint16_t>(std::lround(1.5e6 * std::cos(beam) / far));
        }
      });
  for (int i = 0; i < 5; ++i) {
    fit::CaptureInfo capture;
    capture.last_step = 120;
    capture.target = "wall";
    capture.target_shift_mm = 500.0 * i;
    capture.since_power_on_s = 600 + 30 * i;
    wall.add(capture, 120);
  }
  return look(wall);
}

NoiseFindings spread_of(const Noise& noise, unsigned seed) {
  return look_at_wall(noise, seed, [](const fit::Recording& wall) { return NoiseFindings(wall); });
}

double normal(std::mt19937& random) { return std::normal_distribution<double>()(random); }

/// Samples whose variance grows by `share` of 25 mm^2.
Noise with_more(const std::function<double(double beam_rad, double range_mm)>& share) {
  return [share](double beam, double range, std::mt19937& random) {
    return 5 * std::sqrt(1 + share(beam, range)) * normal(random);
  };
}

void check_unknown(const NoiseFindings& result, fit::Observable observable, fit::Coordinate coordinate) {
  INFO(result.in_words());
  CHECK(result.accepted.empty());
  REQUIRE(result.unknown.size() == 1);
  CHECK(result.unknown.front().observable == observable);
  CHECK(result.unknown.front().coordinate == coordinate);
}

}  // namespace

TEST_CASE(
    "noise that no mechanism makes is called unknown, with its coordinate, and is not called light or weak "
    "echoes") {
  const auto of_beam = with_more([](double beam, double) { return 0.4 * (1 + std::sin(7 * beam)); });
  check_unknown(spread_of(of_beam, 3), fit::Observable::range_variance, fit::Coordinate::beam);
  const auto of_range =
      with_more([](double, double range) { return range > 1800 && range < 2900 ? 0.6 : 0; });
  check_unknown(spread_of(of_range, 4), fit::Observable::range_variance, fit::Coordinate::range);
}

TEST_CASE("noise of the catalogue keeps its name, strong as it may be and with a profile of its own",
          "[rounds]") {
  // A window lets light in with ends that are sharper than the formula's.
  for (const double strength : some_of<double>({0.5, 3, 10})) {
    const auto light =
        with_more([&](double beam, double) { return strength / (1 + std::pow((beam - 0.3) / 0.25, 6)); });
    const NoiseFindings result = spread_of(light, 5);
    INFO(result.in_words());
    CHECK(result.unknown.empty());
    // Light that neither comes and goes nor drowns echoes looks like noise local in the beam.
    CHECK(result.accepted.size() + result.undecided.size() == 1);
    CHECK(result.in_words().find("local-noise") != std::string::npos);
    for (const auto& found : result.accepted) CHECK(found.mechanism->id != "sunlight");
  }
  for (const double strength : some_of<double>({1, 5})) {
    const auto weak = with_more(
        [&](double beam, double range) { return strength * std::pow(range / 3000 / std::cos(beam), 2); });
    const NoiseFindings result = spread_of(weak, 6);
    INFO(result.in_words());
    CHECK(result.unknown.empty());
    REQUIRE(result.accepted.size() == 1);
    CHECK(result.accepted.front().mechanism->id == "intensity-noise");
  }
}

TEST_CASE("constant noise, even with heavier tails than a normal distribution's, is no law of anything",
          "[rounds]") {
  for (unsigned seed = 1; seed <= rounds(20); ++seed) {
    const NoiseFindings plain = spread_of(with_more([](double, double) { return 0; }), seed);
    CHECK(plain.unknown.empty());
    CHECK(plain.accepted.empty());
    const NoiseFindings tailed = spread_of(
        [](double, double, std::mt19937& random) {  // Student's t, 5 degrees of freedom, of variance 25
          return 5 * std::sqrt(0.6) * std::student_t_distribution<double>(5)(random);
        },
        seed);
    INFO(tailed.in_words());
    CHECK(tailed.unknown.empty());
    CHECK(tailed.undecided.empty());
    for (const auto& s : tailed.accepted) CHECK(s.mechanism->id == "outliers");  // the farthest are
  }
}

TEST_CASE("a second cause of which hardly anything is left gains no evidence by deviations of its own") {
  for (unsigned seed = 13; seed < 16; ++seed)
    for (const double times : {20.0, 200.0}) {
      fit::explain::Reduced reduced = look_at_wall(
          with_more([times](double, double) { return times; }), seed, [](const fit::Recording& wall) {
            return fit::explain::reduce(wall, [](double, const std::string&) {});
          });
      const fit::explain::inference::Session session(
          reduced, {}, fit::explain::inference::fit_placements(reduced, {}).there);
      // Far below all echoes a threshold makes noise that is nearly the same everywhere.
      const auto with = [&](const fit::explain::inference::Fitted& before, std::string_view id) {
        for (const auto& candidate : fit::explain::inference::screen(session, before)) {
          if (candidate.term.kind->mechanism->id != id) continue;
          fit::explain::inference::Hypothesis more;
          more.terms = before.hypothesis.terms;
          more.terms.push_back(candidate.term);
          return fit::explain::inference::fit(session, more);
        }
        FAIL(id << " is no candidate");
        return before;
      };
      const fit::explain::inference::Fitted nothing = fit::explain::inference::fit(session, {}),
                                            noise = with(nothing, "range-noise"),
                                            dropout = with(nothing, "dropout"),
                                            both = with(dropout, "range-noise");
      CHECK(both.hypothesis.log_evidence <
            std::max(noise.hypothesis.log_evidence, dropout.hypothesis.log_evidence) + 2);
    }
}

TEST_CASE("a tail of late samples is unknown, and a ghost at one range is not") {
  const auto tail = [](double, double, std::mt19937& random) {
    const double share = std::uniform_real_distribution<double>()(random);
    return 5 * normal(random) + (share < 0.02 ? std::exponential_distribution<double>(1 / 40.0)(random) : 0);
  };
  const NoiseFindings late = spread_of(tail, 7);
  INFO(late.in_words());
  REQUIRE(late.unknown.size() == 1);
  CHECK(late.unknown.front().observable == fit::Observable::range_distribution);
  CHECK(late.unknown.front().describes.find("late") != std::string::npos);
  const auto ghost = [](double, double range, std::mt19937& random) {
    const double share = std::uniform_real_distribution<double>()(random);
    return share < 0.01 ? 400 - range + 5 * normal(random) : 5 * normal(random);
  };
  const NoiseFindings seen = spread_of(ghost, 8);
  CHECK(seen.unknown.empty());
  REQUIRE(seen.accepted.size() == 1);
  CHECK(seen.accepted.front().mechanism->id == "outliers");
}

}  // namespace explain_unnamed_noise_test
