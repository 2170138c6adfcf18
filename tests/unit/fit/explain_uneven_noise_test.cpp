// SPDX-License-Identifier: MIT
// Captures of a few scans of a wall that slants away to both sides: on one of them, whose ranges follow the
// stage's angle as well, it scatters more.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "noise_findings.hpp"
#include "synthetic_recording.hpp"
#include "tests/support/rounds.hpp"

namespace explain_uneven_noise_test {
namespace {

/// 40 captures of six scans; the stage's angle differs from scan to scan by `jitter_deg`.
NoiseFindings spread_of(double jitter_deg, unsigned seed) {
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 121, "front_step": 60,
    "step_deg": 1, "scan_hz": 40}, "targets": [{"name": "wall", "from_mm": [1000, -6000], "to_mm": [1000, 6000],
    "u_mm": 1}], "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 5, "u": 0.25}}}]})");
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  SyntheticRecording wall(bench, [&](const fit::CaptureInfo&, std::int64_t, std::vector<std::uint16_t>& range,
                                     std::vector<std::uint16_t>& intensity) {
    const double jitter = jitter_deg * fit::rad_per_deg * normal(random);
    for (std::size_t k = 0; k < range.size(); ++k) {
      const double beam = (static_cast<double>(k) - 60) * fit::rad_per_deg + jitter,
                   far = 1000 / std::cos(beam), sigma = beam > 0.6 ? 20 : 4;
      range[k] = static_cast<std::uint16_t>(std::lround(far + sigma * normal(random)));
      intensity[k] = static_cast<std::uint16_t>(std::lround(1.5e6 * std::cos(beam) / far));
    }
  });
  for (int i = 0; i < 40; ++i) {
    fit::CaptureInfo capture;
    capture.last_step = 120;
    capture.since_power_on_s = 600 + 30 * i;
    wall.add(capture, 6);
  }
  return NoiseFindings(wall);
}

bool holds(const NoiseFindings& result, const char* id) {
  return std::ranges::any_of(result.accepted, [&](const auto& s) { return s.mechanism->id == id; }) ||
         std::ranges::any_of(result.undecided,
                             [&](const auto& set) { return std::ranges::count(set, id) > 0; });
}

}  // namespace

TEST_CASE("noise that differs from beam to beam is nothing that whole scans have in common", "[rounds]") {
  for (unsigned seed = 1; seed <= rounds(20); ++seed) {
    const NoiseFindings result = spread_of(0, seed);
    INFO("seed " << seed << ": " << result.in_words());
    CHECK_FALSE(holds(result, "angle-jitter"));
    CHECK_FALSE(holds(result, "correlated-noise"));
  }
}

TEST_CASE("beside such noise a stage that jitters is found", "[rounds][long]") {
  constexpr double jitter_deg = 0.1;
  for (unsigned seed = 1; seed <= rounds(5); ++seed) {
    const NoiseFindings result = spread_of(jitter_deg, seed);
    INFO("seed " << seed << ": " << result.in_words());
    const auto jitter = std::ranges::find_if(
        result.accepted, [](const auto& s) { return s.mechanism->id == std::string("angle-jitter"); });
    REQUIRE(jitter != result.accepted.end());
    CHECK(jitter->parameters.at("sigma_deg").value == Approx(jitter_deg).margin(0.03));
  }
}

TEST_CASE("noise that follows weak echoes as stated is not named again where beams lie a degree apart") {
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1", "lidar": {"steps": 121, "front_step": 60,
    "step_deg": 1, "scan_hz": 40}, "targets": [{"name": "wall", "from_mm": [1500, -6000], "to_mm": [1500, 6000],
    "u_mm": 1}], "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 3, "u": 0.1}}},
    {"mechanism": "intensity-noise", "parameters": {"sigma_mm_at_100_counts": 6, "exponent": 2}}]})");
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  SyntheticRecording wall(bench, [&](const fit::CaptureInfo&, std::int64_t, std::vector<std::uint16_t>& range,
                                     std::vector<std::uint16_t>& intensity) {
    for (std::size_t k = 0; k < range.size(); ++k) {
      const double slant = (static_cast<double>(k) - 60) * fit::rad_per_deg, far = 1500 / std::cos(slant),
                   counts = 1000 * std::pow(std::cos(slant), 3), sigma = std::hypot(3, 6 * 100 / counts);
      range[k] = static_cast<std::uint16_t>(std::lround(far + sigma * normal(random)));
      intensity[k] = static_cast<std::uint16_t>(std::lround(counts));
    }
  });
  fit::CaptureInfo capture;
  capture.last_step = 120;
  for (int i = 0; i < 30; ++i) wall.add(capture, 200);
  const NoiseFindings result(wall);
  INFO(result.in_words());
  CHECK(result.accepted.empty());
  CHECK(result.undecided.empty());
  CHECK(result.unknown.empty());
}

}  // namespace explain_uneven_noise_test
