// SPDX-License-Identifier: MIT
// What a bench file that knows of mechanisms predicts of captures, against recordings of another generator.
#include "fit/explain/experiment/forecast.hpp"

#include <catch2/catch.hpp>
#include <vector>

#include "fit/known_mechanisms.hpp"
#include "fit/mechanism.hpp"
#include "plain_scenes.hpp"

namespace forecast_test {
namespace {

using fit::explain::ForecastScore;
using plain_bench::degree;
using plain_bench::Deviation;
using plain_bench::PlainScene;

TEST_CASE("angles that are off by degrees are predicted to meet the targets which they meet") {
  constexpr double off_deg = -7;
  PlainScene scene{.walls = plain_bench::furnished, .steps = 541, .front_step = 270, .step_deg = 0.5};
  scene.u_mm = scene.u_mount_mm = 0.1;
  scene.u_deg = scene.u_yaw_deg = 0.01;
  SyntheticRecording recording = plain_bench::recorded(
      scene, 4, [](double, double, double) { return Deviation{.beam_rad = off_deg * degree}; });
  plain_bench::turn_round(recording, scene, 6, 10);
  fit::Bench twin = recording.bench();
  fit::add_known(twin,
                 fit::as_known(*fit::find_mechanism("index-offset"), {{"offset_deg", {off_deg, 0.01}}}));
  const ForecastScore score =
      fit::explain::score(fit::explain::forecast(twin, recording.captures(), {}), twin, recording);
  INFO("means off by " << score.rms_of_means_mm << " mm, " << score.expected_rms_of_means_mm << " expected");
  CHECK(score.beams.size() > 1500);
  CHECK(score.rms_of_means_mm < 1.5 * score.expected_rms_of_means_mm);
  CHECK(score.coverage_95_of_means > 0.9);
}

}  // namespace
}  // namespace forecast_test
