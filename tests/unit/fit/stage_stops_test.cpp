// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <string>

#include "fit/explain/explanation.hpp"
#include "slanted_room.hpp"
#include "synthetic_recording.hpp"

namespace stage_stops_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;

/// Four captures at each of six stage angles, of which nothing is missing: the stage errs by up to half of
/// its resolution, anew at every capture or once for all four.
Explanation explained(bool anew_at_every_capture, unsigned seed) {
  const fit::Bench bench =
      slanted_room::bench(R"({"value": 1.5, "u": 0.1})", R"("stage": {"resolution_deg": 0.01}, )");
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1.5);
  std::uniform_real_distribution<double> of_stage(-0.005 * degree, 0.005 * degree);
  double off = 0;
  SyntheticRecording recording(
      bench, [&](const fit::CaptureInfo& capture, std::int64_t seq, auto& range, auto&) {
        const auto number = static_cast<int>(std::lround((*capture.since_power_on_s - 100) / 20));
        if (seq == 0 && (anew_at_every_capture || number % 4 == 0)) off = of_stage(random);
        for (std::size_t k = 0; k < range.size(); ++k) {
          const double beam = (static_cast<double>(k) - 135) * degree;
          const auto met =
              plain_bench::look(slanted_room::walls, slanted_room::mount, capture.stage_rad + off, beam, {});
          range[k] = static_cast<std::uint16_t>(std::lround(met->range_mm + noise(random)));
        }
      });
  for (int i = 0; i < 24; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = 60.0 * (i / 4) * degree;
    capture.approach = 1;
    capture.since_power_on_s = 100 + 20 * i;
    capture.last_step = 270;
    recording.add(capture, 30);
  }
  return fit::explain::explain({&recording}, {});
}

}  // namespace

TEST_CASE("a stage that errs anew at every capture, or once at every stop, misses nothing") {
  const bool anew_at_every_capture = GENERATE(true, false);
  for (const unsigned seed : {1U, 2U, 3U, 4U}) {
    const Explanation e = explained(anew_at_every_capture, seed);
    INFO("seed " << seed << ": " << to_text(e));
    CHECK(e.verdict == "nothing-missing");
  }
}

}  // namespace stage_stops_test
