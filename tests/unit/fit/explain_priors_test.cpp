// SPDX-License-Identifier: MIT
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "fit/explain/explanation.hpp"
#include "plain_scenes.hpp"
#include "tests/support/rounds.hpp"

namespace explain_priors_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;
using plain_bench::PlainScene;
using plain_bench::Point;

/// A board of that width brought from 0.5 to so many metres, squarely before the lidar; ranges as `spoil`
/// makes them.
Explanation explained_ladder(double width_mm, int rungs, double apart_mm, unsigned seed,
                             const std::function<double(double range_mm)>& spoil) {
  const PlainScene scene{.walls = {{{500, -width_mm / 2}, {500, width_mm / 2}}},
                         .u_mm = 1,
                         .steps = 1081,
                         .front_step = 540,
                         .step_deg = 0.25,
                         .sigma_mm = 5};
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const PlainScene stands = plain_bench::drawn(scene, random);
  const plain_bench::Mount mount{3 * normal(random), 3 * normal(random), 0.3 * normal(random)};
  SyntheticRecording recording(plain_bench::bench_of(scene), [&](const fit::CaptureInfo& info, std::int64_t,
                                                                 auto& range, auto& intensity) {
    PlainScene there = stands;
    const Point shift(info.target_shift_mm, 0);
    there.walls[0] = {there.walls[0].from + shift, there.walls[0].to + shift};
    for (std::size_t k = 0; k < range.size(); ++k) {
      const double beam = (info.first_step + static_cast<double>(k) - 540) * 0.25 * degree;
      const auto met = plain_bench::look(there, mount, info.stage_rad, beam);
      range[k] = intensity[k] = 0;
      if (!met) continue;
      range[k] =
          static_cast<std::uint16_t>(std::lround(met->range_mm + spoil(met->range_mm) + 5 * normal(random)));
      intensity[k] = static_cast<std::uint16_t>(3e6 / met->range_mm);
    }
  });
  for (int i = 0; i < rungs; ++i) {
    fit::CaptureInfo capture;
    capture.target = "wall 1";
    capture.target_shift_mm = apart_mm * i;
    capture.first_step = 520;
    capture.last_step = 560;
    capture.since_power_on_s = 3600 + 30 * i;
    recording.add(capture, 60);
  }
  return fit::explain::explain({&recording}, {});
}

}  // namespace

TEST_CASE("a scale of the range is not taken for a mount and a board far from where they are stated") {
  const double per_m = GENERATE(1.8, -4.7);
  const Explanation e =
      explained_ladder(400, 19, 480, 7, [&](double range_mm) { return per_m * range_mm / 1000; });
  INFO(to_text(e));
  // On one surface whose echo weakens with the distance a walk may do the same: then it is a set.
  if (e.mechanisms.empty()) {
    REQUIRE(e.undecided_between.size() == 1);
    CHECK(e.undecided_between.front().front() == "range-scale");
  } else {
    REQUIRE(e.mechanisms.size() == 1);
    CHECK(e.mechanisms.front().mechanism->id == "range-scale");
  }
  CHECK(e.before.rms_mm > 3 * e.after.rms_mm);  // nothing was bent to take its place
  // A board that is merely far has no more beams beside its ends than one that stands as it should.
  if (per_m > 0) CHECK(e.left_out <= explained_ladder(400, 19, 480, 7, [](double) { return 0.0; }).left_out);
}

TEST_CASE("bins of a counter are found on a ladder, wherever within a bin mount and board stand",
          "[rounds]") {
  // Half a bin and more: bins count from true ranges, which are known only once mount and board are fitted.
  constexpr double bin_mm = 9.7;
  for (const unsigned seed : some_of<unsigned>({11, 12, 13, 14, 15, 16, 17, 18})) {
    const Explanation e = explained_ladder(300, 37, 93.1, seed, [](double range_mm) {
      return bin_mm * std::round(range_mm / bin_mm) - range_mm;
    });
    INFO("seed " << seed << "\n" << to_text(e));
    const auto found = std::ranges::find_if(
        e.mechanisms, [](const auto& m) { return m.mechanism->id == "time-quantisation"; });
    REQUIRE(found != e.mechanisms.end());
    CHECK(found->parameters.at("bin_mm").value == Approx(bin_mm).margin(0.005));
    CHECK_FALSE(e.unknown);
  }
}

TEST_CASE("a ladder of which nothing is missing") {
  const Explanation e = explained_ladder(400, 19, 480, 8, [](double) { return 0.0; });
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
}

}  // namespace explain_priors_test
