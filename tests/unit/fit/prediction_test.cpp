// SPDX-License-Identifier: MIT
// How hypotheses predict a recording of another generator in which what they say does not happen.
#include "fit/explain/prediction.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <utility>
#include <vector>

#include "fit/known_mechanisms.hpp"
#include "fit/mechanism.hpp"
#include "plain_scenes.hpp"

namespace prediction_test {
namespace {

using fit::explain::Prediction;
using fit::explain::Predictor;
using plain_bench::PlainScene;

constexpr double constant_mm = 5;  // as the scene has it

/// A description in which all ranges are longer in proportion.
Predictor::Description longer(double probability, fit::Estimate per_mm) {
  return {
      probability, {fit::as_known(*fit::find_mechanism("range-scale"), {{"scale", per_mm}})}, {constant_mm}};
}

/// Of a lidar that reads right, within walls that are known well.
Prediction predicted(std::vector<Predictor::Description> descriptions) {
  PlainScene scene{.walls = plain_bench::furnished, .steps = 541, .front_step = 270, .step_deg = 0.5};
  scene.u_mm = scene.u_mount_mm = 0.5;
  scene.u_deg = scene.u_yaw_deg = 0.02;
  SyntheticRecording recording =
      plain_bench::recorded(scene, 9, [](double, double, double) { return plain_bench::Deviation{}; });
  plain_bench::turn_round(recording, scene, 6, 10);
  Predictor predictor;
  predictor.descriptions = std::move(descriptions);
  predictor.constant_before = {constant_mm};
  return fit::explain::predict_recording(predictor, recording);
}

TEST_CASE("a finding that is as uncertain as it is large costs a prediction little; one that is sure, much") {
  const Prediction sure = predicted({longer(1, {20e-3, 1e-5})});
  CHECK(sure.gain < -1000);
  const Prediction uncertain = predicted({longer(1, {20e-3, 20e-3})});
  CHECK(uncertain.gain < 0);
  CHECK(uncertain.gain > -20);  // how it deviates from its formula is open as well
  CHECK(uncertain.after.coverage_95 > 0.93);
}

TEST_CASE("of two hypotheses that are alike probable the wrong one costs a prediction one choice of two") {
  const Prediction both = predicted({longer(0.5, {20e-3, 1e-5}), {0.5, {}, {constant_mm}}});
  CHECK(both.gain == Approx(std::log(0.5)).margin(0.01));
  CHECK(both.after.coverage_95 > 0.93);
  CHECK(both.after.rms_of_means_mm > both.before.rms_of_means_mm);  // nobody knew which one it was
}

}  // namespace
}  // namespace prediction_test
