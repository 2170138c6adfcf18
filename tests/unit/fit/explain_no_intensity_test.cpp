// SPDX-License-Identifier: MIT
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "fit/explain/explanation.hpp"
#include "fit/numeric/angle.hpp"
#include "synthetic_recording.hpp"

namespace explain_no_intensity_test {
namespace {

/// A board of two greys at ten distances, by a lidar that sends no intensities and reads weak echoes long by
/// so much where the echo is that of a white board at 1 m.
fit::explain::Explanation ladder(double walk_mm) {
  const fit::Bench bench = fit::parse_bench(R"({"schema": "bench/1",
    "lidar": {"steps": 41, "front_step": 20, "step_deg": 0.25, "scan_hz": 40,
      "mount": {"x_mm": {"value": 0, "u": 1}, "y_mm": {"value": 0, "u": 1}, "yaw_deg": {"value": 0, "u": 0.2}}},
    "targets": [{"name": "board", "from_mm": [500, -400], "to_mm": [500, 400], "u_mm": 1, "u_deg": 0.2}],
    "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": {"value": 4, "u": 0.4}}}]})");
  std::mt19937 random(11);
  std::normal_distribution<double> noise(0, 4);
  SyntheticRecording recording(
      bench, [&](const fit::CaptureInfo& capture, std::int64_t, auto& range, auto& intensity) {
        intensity.clear();
        const double away_mm = 500 + capture.target_shift_mm;
        for (std::size_t k = 0; k < range.size(); ++k) {
          const double beam = (static_cast<double>(k) - 20) * 0.25 * fit::rad_per_deg,
                       mm = away_mm / std::cos(beam),
                       echo = *capture.reflectance * std::cos(beam) * std::pow(1000 / mm, 2);
          range[k] = static_cast<std::uint16_t>(std::lround(mm + walk_mm / std::sqrt(echo) + noise(random)));
        }
      });
  for (int i = 0; i < 20; ++i) {
    fit::CaptureInfo capture;
    capture.target = "board";
    capture.target_shift_mm = 400.0 * (i / 2);
    capture.reflectance = i % 2 == 0 ? 0.9 : 0.12;
    capture.last_step = 40;
    capture.since_power_on_s = 3600 + 30 * i;
    recording.add(capture, 100);
  }
  return fit::explain::explain({&recording}, {});
}

}  // namespace

TEST_CASE("without intensities what follows the echo is told by the one that the bench file lets expect") {
  const auto e = ladder(1);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "range-walk");
  CHECK(e.undecided_between.empty());
  CHECK_FALSE(e.unknown);
  CHECK(std::ranges::any_of(e.notes, [](const std::string& note) {
    return note.find("No intensities were recorded") != std::string::npos;
  }));
}

TEST_CASE("without intensities nothing is missing where nothing is") {
  const auto e = ladder(0);
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
}

}  // namespace explain_no_intensity_test
