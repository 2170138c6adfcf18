// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>

#include "fit/explain/explanation.hpp"
#include "fit/explain/model/channel.hpp"
#include "fit/explain/reduction/reduce.hpp"
#include "plain_scenes.hpp"
#include "tests/support/rounds.hpp"

namespace explain_scenes_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;
using plain_bench::Deviation;
using plain_bench::PlainScene;

Deviation nothing(double, double, double) { return {}; }

Explanation explained(const PlainScene& scene, unsigned seed, const plain_bench::Conceal& conceal) {
  SyntheticRecording recording = plain_bench::recorded(scene, seed, conceal);
  plain_bench::turn_round(recording, scene);
  return fit::explain::explain({&recording}, {});
}

const PlainScene l_room{.walls = plain_bench::l_shaped}, corridor{.walls = plain_bench::corridor},
    furnished{.walls = plain_bench::furnished},
    with_posts{.walls = plain_bench::furnished,
               .posts = {{{-900, 500}, 80}, {{500, -1000}, 55}, {{300, 1200}, 40}}};

/// Every second or fourth beam of the lidar.
PlainScene at_spacing(PlainScene scene, double step_deg) {
  scene.front_step = static_cast<int>(std::lround(135 / step_deg));
  scene.steps = 2 * scene.front_step + 1;
  scene.step_deg = step_deg;
  return scene;
}

bool names_or_holds(const Explanation& e, const char* id) {
  const auto in = [&](const std::vector<std::string>& set) { return std::ranges::count(set, id) > 0; };
  return std::ranges::any_of(e.mechanisms, [&](const auto& m) { return m.mechanism->id == id; }) ||
         std::ranges::any_of(e.undecided_between, in);
}

}  // namespace

TEST_CASE("nothing is missing in scenes of any shape", "[rounds]") {
  const auto& [scene, what] = GENERATE(from_range(
      some_of<std::pair<PlainScene, const char*>>({{l_room, "an L-shaped room"},
                                                   {corridor, "a corridor"},
                                                   {furnished, "boards before walls"},
                                                   {with_posts, "round posts"},
                                                   {at_spacing(l_room, 1), "beams 1 deg apart"}})));
  const Explanation e = explained(scene, 3, nothing);
  INFO(what << "\n" << to_text(e));
  CHECK(e.verdict == "nothing-missing");
}

TEST_CASE("a code disk off its axis is found in scenes of any shape", "[rounds]") {
  const auto& [scene, what] = GENERATE(from_range(
      some_of<std::pair<PlainScene, const char*>>({{l_room, "an L-shaped room"},
                                                   {furnished, "boards before walls"},
                                                   {with_posts, "round posts"},
                                                   {at_spacing(l_room, 1), "beams 1 deg apart"}})));
  const Explanation e = explained(scene, 4, [](double beam, double, double) {
    return Deviation{.beam_rad = 0.12 * degree * std::sin(beam + 0.7)};
  });
  INFO(what << "\n" << to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "encoder-eccentricity");
  const auto& found = e.mechanisms.front().parameters.at("amplitude_deg");
  CHECK(std::abs(found.value - 0.12) < 4 * found.u);
}

TEST_CASE("play of the stage is found in an L-shaped room") {
  int turn = 0;
  SyntheticRecording recording = plain_bench::recorded(l_room, 5, [&](double, double stage, double time_s) {
    (void)stage;
    turn = static_cast<int>((time_s - 1800) / 20);
    return Deviation{.stage_rad = -0.05 * degree * (turn == 0 ? 0 : turn <= 7 ? 1 : -1)};
  });
  plain_bench::turn_round(recording, l_room);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(names_or_holds(e, "backlash"));
  CHECK(e.mechanisms.size() <= 1);
}

TEST_CASE("light over a corner's other wall is told as such, be every corner another one") {
  const PlainScene room{.walls = {{{2600, -1900}, {2600, 3100}},
                                  {{2600, 3100}, {-1700, 3100}},
                                  {{-1700, 3100}, {-1700, -1900}},
                                  {{-1700, -1900}, {2600, -1900}}}};
  const auto light = [&](double beam_rad, double stage_rad, double) {
    constexpr double at_end_mm[] = {9, 2, 5, 1}, at_begin_mm[] = {1, 7, 2, 4};
    const auto met = look(room, {}, stage_rad, beam_rad);
    if (!met) return Deviation{};
    const double half = std::abs(room.walls[met->wall].to - room.walls[met->wall].from) / 2;
    const double most = (met->along_mm > 0 ? at_end_mm : at_begin_mm)[met->wall];
    return Deviation{.range_mm = most * std::exp(-(half - std::abs(met->along_mm)) / 180)};
  };
  const Explanation e = explained(room, 21, light);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "multipath");
  CHECK_FALSE(e.unknown);
}

TEST_CASE("angles that step at one beam are a step there, however many samples", "[long]") {
  constexpr double at_deg = -61.9;
  const auto step = [](double beam_rad, double, double) {
    return Deviation{.beam_rad = beam_rad > at_deg * degree ? 0.12 * degree : 0};
  };
  SyntheticRecording recording = plain_bench::recorded(l_room, 22, step);
  plain_bench::turn_round(recording, l_room, 14, 40);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  REQUIRE(e.unknown);
  CHECK(e.unknown->coordinate == fit::Coordinate::beam);
  CHECK_THAT(e.unknown->describes, Catch::StartsWith("the beam angle steps by 0.1"));
  CHECK((e.unknown->from + e.unknown->to) / 2 == Approx(at_deg).margin(1));
}

TEST_CASE("bins of the flight time are found on slanted walls, where neighbours fall into others", "[long]") {
  PlainScene scene = at_spacing(l_room, 0.25);
  scene.u_mm = scene.u_mount_mm = 0.001;
  scene.u_deg = scene.u_yaw_deg = 0.0001;
  constexpr double bin_mm = 2.3;
  const auto counted = [&](double beam_rad, double stage_rad, double) {
    const auto met = look(scene, {}, stage_rad, beam_rad);
    const double range = met ? met->range_mm : 0;
    return Deviation{.range_mm = bin_mm * std::round(range / bin_mm) - range};
  };
  const Explanation e = explained(scene, 23, counted);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "time-quantisation");
  CHECK(e.mechanisms.front().parameters.at("bin_mm").value == Approx(bin_mm).margin(0.001));
  CHECK_FALSE(e.unknown);
}

TEST_CASE(
    "the sides of round posts say nothing of the beam's width, by their light or by samples before the "
    "wall") {
  const PlainScene scene = at_spacing({.walls = plain_bench::furnished, .posts = with_posts.posts}, 0.25);
  SyntheticRecording recording = plain_bench::recorded(scene, 24, nothing);
  plain_bench::turn_round(recording, scene);
  const auto reduced = fit::explain::reduce(recording, {});
  for (const char* channel : {"footprint", "blend"}) {
    INFO(channel);
    const auto& kind = fit::explain::model::channel_kinds()[fit::explain::model::channel_of(channel)];
    const auto rows = kind.rows(reduced, {});
    int of_posts = 0;
    for (Eigen::Index i = 0; rows && i < rows->rows(); ++i) {
      const int target = rows->at(i).target;
      of_posts += target >= 0 && reduced.bench.target_at(target).round;
    }
    CHECK(of_posts == 0);
  }
}

TEST_CASE("ranges predicted of a post that stands elsewhere and is thicker are those of a circle there") {
  PlainScene scene{.walls = plain_bench::furnished, .posts = with_posts.posts};
  SyntheticRecording recording = plain_bench::recorded(scene, 50, nothing);
  plain_bench::turn_round(recording, scene, 6, 4);
  constexpr double out_mm = 12, aside_mm = -9, thicker_mm = 7;
  const auto post = static_cast<int>(scene.walls.size());
  fit::explain::Reduced reduced = fit::explain::reduce(recording, {});
  fit::explain::predict(reduced, fit::explain::Nuisance(reduced.bench),
                        {{fit::not_owned(*fit::find_mechanism("target-offset")), {out_mm, aside_mm}, post},
                         {fit::not_owned(*fit::find_mechanism("target-radius")), {thicker_mm}, post}},
                        false);
  plain_bench::Post& there = scene.posts.front();
  there.centre += there.centre / std::abs(there.centre) * plain_bench::Point(out_mm, aside_mm);
  there.radius += thicker_mm;
  int met = 0;
  for (const fit::explain::Cell& cell : reduced.cells) {
    const auto seen = plain_bench::look(scene, {}, reduced.capture_of(cell).stage_rad, cell.beam_rad);
    if (!cell.usable || cell.at.target != post || !seen || seen->wall != static_cast<std::size_t>(post))
      continue;
    CHECK(cell.nominal_mm == Approx(seen->range_mm).margin(1e-6));
    CHECK(cell.at.half_length_mm == Approx(there.radius * fit::pi / 2));
    ++met;
  }
  CHECK(met > 30);
}

TEST_CASE("a post elsewhere than the bench file says, or a thicker one, is told as that, and is not bent") {
  const PlainScene scene{
      .walls = plain_bench::furnished, .posts = with_posts.posts, .step_deg = 0.25, .sigma_mm = 5};
  const PlainScene there = at_spacing(scene, 0.5);
  for (const auto& [dx, dy, thicker] : std::vector<std::array<double, 3>>{{10, 0, 0}, {7, 8, 0}, {0, 0, 6}}) {
    PlainScene written = there;
    written.posts.front().centre -= plain_bench::Point(dx, dy);
    written.posts.front().radius -= thicker;
    SyntheticRecording recording = plain_bench::recorded(there, 51, nothing, {}, written);
    plain_bench::turn_round(recording, there);
    const Explanation e = fit::explain::explain({&recording}, {});
    INFO(dx << " " << dy << " " << thicker << "\n" << to_text(e));
    REQUIRE(e.mechanisms.size() == 1);
    CHECK_FALSE(e.unknown);
    const auto& found = e.mechanisms.front();
    CHECK(found.target == "post 1");
    const auto holds = [&](const char* name, double truth) {
      const fit::Estimate& estimate = found.parameters.at(name);
      CHECK(std::abs(estimate.value - truth) < 3 * estimate.u);
    };
    if (thicker > 0) {
      CHECK(found.mechanism->id == "target-radius");
      holds("thicker_mm", thicker);
    } else {
      CHECK(found.mechanism->id == "target-offset");
      // What it was drawn to stand off by as well is its uncertainty.
      const plain_bench::Point out = written.posts.front().centre / std::abs(written.posts.front().centre),
                               off = plain_bench::Point(dx, dy) / out;
      CHECK(std::abs(found.parameters.at("offset_mm").value - off.real()) < 4 * scene.u_mm);
      CHECK(std::abs(found.parameters.at("aside_mm").value - off.imag()) < 4 * scene.u_mm);
    }
  }
}

TEST_CASE("where posts end is not known well enough for ranges at their sides to tell of anything",
          "[rounds]") {
  for (const unsigned seed : some_of<unsigned>({31, 32, 33, 34, 35, 36, 37, 38, 39, 40})) {
    PlainScene scene{.walls = plain_bench::furnished, .posts = with_posts.posts, .u_mm = 4};
    scene.steps = 361;
    scene.front_step = 180;
    scene.u_mount_mm = 10;
    scene.u_yaw_deg = 1;
    SyntheticRecording recording = plain_bench::recorded(scene, seed, nothing);
    plain_bench::turn_round(recording, scene, 6, 120);
    const Explanation e = fit::explain::explain({&recording}, {});
    INFO("seed " << seed << "\n" << to_text(e));
    CHECK(e.verdict == "nothing-missing");
  }
}

}  // namespace explain_scenes_test
