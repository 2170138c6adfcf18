// SPDX-License-Identifier: MIT
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <set>
#include <vector>

#include "noise_findings.hpp"
#include "synthetic_recording.hpp"

namespace explain_held_out_test {
namespace {

/// Of samples on the lit wall, mm^2.
double variance_at(double beam_deg) { return 25 + 9 * std::exp(-0.5 * std::pow((beam_deg - 20) / 10, 2)); }

/// What is said of a wall, 1 m away, on which light falls around beam 20 deg in all five captures. `gain`: by
/// which those samples are likelier under what was drawn than under the same noise everywhere.
NoiseFindings spread_of_lit_wall(unsigned seed, double& gain) {
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
  NoiseFindings findings(wall);
  gain = squares;
  return findings;
}

}  // namespace

TEST_CASE("light on a wall gains in captures that it was not fitted to what it is worth there") {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    double gain = 0;
    const auto result = spread_of_lit_wall(seed, gain);
    // It neither comes and goes nor drowns echoes: noise local in the beam would look the same.
    INFO(result.in_words());
    REQUIRE(result.accepted.size() + result.undecided.size() == 1);
    CHECK(result.in_words().find("local-noise") != std::string::npos);
    CAPTURE(seed, gain, result.gain);
    CHECK(result.gain > 0.8 * gain);
    CHECK(result.gain < 1.1 * gain);
  }
}

TEST_CASE("the scatter of samples is drawn as it was, and as it is explained") {
  double gain = 0;
  const auto result = spread_of_lit_wall(7, gain);
  const auto drawn = std::ranges::find(result.curves, fit::Observable::range_variance,
                                       &fit::explain::SpreadCurve::observable);
  REQUIRE(drawn != result.curves.end());
  const fit::explain::SpreadCurve& curve = *drawn;
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

}  // namespace explain_held_out_test
