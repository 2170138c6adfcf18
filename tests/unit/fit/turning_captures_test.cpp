// SPDX-License-Identifier: MIT
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "fit/explain/model/stage_stops.hpp"
#include "fit/explain/reduction/reduce.hpp"
#include "plain_room.hpp"

namespace turning_captures_test {
namespace {

using fit::explain::Cell;
using fit::explain::Reduced;
using plain_bench::degree;

constexpr double yaw_deg = 1.2;  // of the mount; the bench file says 0

/// The room without noise, seen while the stage turns.
SyntheticRecording turning(int captures) {
  const fit::Bench bench = plain_bench::bench_of_room(R"("steps": 541, "front_step": 270, "step_deg": 0.5)",
                                                      R"({"value": 0.3, "u": 0.1})");
  SyntheticRecording recording(
      bench, [](const fit::CaptureInfo& capture, std::int64_t seq, auto& range, auto&) {
        const double stage = capture.stage_rad + capture.stage_rate_rad_s * 0.025 * static_cast<double>(seq);
        for (std::size_t k = 0; k < range.size(); ++k) {
          const double beam = (static_cast<double>(k) - 270) * 0.5 * degree;
          range[k] = static_cast<std::uint16_t>(
              std::lround(plain_bench::look(plain_bench::room, {0, 0, yaw_deg}, stage, beam)->range_mm));
        }
      });
  for (int i = 0; i < captures; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = 40.0 * i * degree;
    capture.stage_rate_rad_s = (i % 2 == 0 ? 20 : -20) * degree;
    capture.last_step = 540;
    capture.since_power_on_s = 100 + 20 * i;
    recording.add(capture, 20);
  }
  return recording;
}

}  // namespace

TEST_CASE("beams of a turning stage that are taken together on both sides of a corner are not compared") {
  const SyntheticRecording recording = turning(4);
  Reduced reduced = fit::explain::reduce(recording, {});
  fit::explain::Nuisance there(reduced.bench);
  there.yaw_rad = yaw_deg * degree;
  predict(reduced, there, {}, false);
  fit::explain::reassign(reduced, there, {}, 0);
  int smooth = 0;
  double worst_mm2 = 0;
  for (const Cell& cell : reduced.cells) {
    if (!cell.usable) continue;
    ++smooth;
    worst_mm2 = std::max(worst_mm2, cell.variance_mm2 - cell.of_joining_mm2());
  }
  REQUIRE(smooth > 8000);
  CHECK(worst_mm2 < 6);  // rounding, and walls that are no parabola at grazing incidence
}

TEST_CASE("the stage's error is drawn once for every capture in which it turns") {
  const SyntheticRecording recording = turning(3);
  const Reduced reduced = fit::explain::reduce(recording, {});
  REQUIRE(reduced.groups.size() == 60);
  const auto stops = fit::explain::stops_of(reduced);
  REQUIRE(stops.size() == 3);
  CHECK(stops[1].first_group == 20);
  CHECK(stops[1].last_group == 40);
}

}  // namespace turning_captures_test
