// SPDX-License-Identifier: MIT
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>

#include "fit/explain/explanation.hpp"
#include "plain_room.hpp"
#include "tests/support/rounds.hpp"

namespace explain_eccentricity_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;
using plain_bench::Deviation;

const plain_bench::Mount mount{12, -7, 35};

/// The room seen all round by a lidar that sits askew on its stage.
Explanation explained(const std::function<Deviation(double beam_rad, double stage_rad)>& off) {
  const fit::Bench bench = plain_bench::bench_of_room(
      R"("steps": 271, "front_step": 135, "step_deg": 1, "mount": {"x_mm": {"value": 12, "u": 0.2},
    "y_mm": {"value": -7, "u": 0.2}, "yaw_deg": {"value": 35, "u": 0.3}})",
      R"({"value": 3, "u": 0.3})");
  std::mt19937 random(4);
  std::normal_distribution<double> noise(0, 3);
  SyntheticRecording recording(bench, [&](const fit::CaptureInfo& capture, std::int64_t, auto& range, auto&) {
    for (std::size_t k = 0; k < range.size(); ++k) {
      const double beam = (static_cast<double>(k) - 135) * degree;
      const auto met =
          plain_bench::look(plain_bench::room, mount, capture.stage_rad, beam, off(beam, capture.stage_rad));
      range[k] = static_cast<std::uint16_t>(std::lround(met->range_mm + noise(random)));
    }
  });
  plain_bench::record_all_round(recording);
  return fit::explain::explain({&recording}, {});
}

/// Both angles in degrees.
double apart(double one, double other) { return std::abs(std::remainder(one - other, 360)); }

}  // namespace

TEST_CASE(
    "the phase of a code disk off its axis is counted from the front beam, however the lidar is mounted",
    "[rounds]") {
  const double phase_deg = GENERATE(from_range(some_of<double>({-150, 40, 115})));
  const Explanation e = explained([&](double beam, double) {
    return Deviation{.beam_rad = 0.15 * degree * std::sin(beam + phase_deg * degree)};
  });
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  REQUIRE(e.mechanisms.front().mechanism->id == "encoder-eccentricity");
  const auto& found = e.mechanisms.front().parameters;
  CHECK(std::abs(found.at("amplitude_deg").value - 0.15) < 4 * found.at("amplitude_deg").u);
  CHECK(apart(found.at("phase_deg").value, phase_deg) < 4 * found.at("phase_deg").u);
}

TEST_CASE("the phase of an axis that runs out points to where the axis is at stage angle 0, in the world",
          "[rounds]") {
  const double phase_deg = GENERATE(from_range(some_of<double>({-150, 40, 115})));
  const Explanation e = explained([&](double, double stage) {
    return Deviation{.origin_mm = std::polar(2.0, stage + phase_deg * degree)};
  });
  INFO(to_text(e));
  // Any arm is as good, and the bench file itself may be wrong: a set, whose members have their values.
  const fit::Active* found = nullptr;
  for (const fit::Active& term : e.suspects)
    if (term.mechanism->id == "stage-eccentricity") found = &term;
  REQUIRE(found);
  CHECK(std::abs(found->values[0] - 2) < 4 * found->sigma[0]);
  CHECK(apart(found->values[1], phase_deg) < 4 * found->sigma[1]);
}

}  // namespace explain_eccentricity_test
