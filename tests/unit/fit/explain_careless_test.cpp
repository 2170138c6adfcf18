// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/explanation.hpp"
#include "fit/explain/inference/session.hpp"
#include "fit/explain/inference/steps.hpp"
#include "plain_room.hpp"
#include "plain_scenes.hpp"

/// Benches in which somebody walks about, mistypes, or knocks against something.
namespace explain_careless_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;

/// Stops of a stage; what a recording says of them, and where it really stood.
struct Stop {
  double stated_deg, true_deg;
  std::optional<double> says_deg{};  ///< By its readback.
};

/// Something that moves between lidar and walls: how far it is at that bearing (deg) in that scan, mm; 0: no
/// echo comes back; or nothing.
using Thing =
    std::function<std::optional<double>(int stop, std::int64_t seq, double bearing_deg, double wall_mm)>;

const char* const geometry =
    R"("steps": 361, "front_step": 180, "step_deg": 0.75, "mount": {"x_mm": {"value": 0, "u": 3},
    "y_mm": {"value": 0, "u": 3}, "yaw_deg": {"value": 10, "u": 0.3}})";

std::vector<Stop> stops_all_round(int count) {
  std::vector<Stop> stops;
  for (int i = 0; i < count; ++i) {
    const double deg = std::remainder(i * 360.0 / count, 360.0);
    stops.push_back({deg, deg});
  }
  return stops;
}

SyntheticRecording recorded(const std::vector<Stop>& stops, int scans, const Thing& thing, unsigned seed) {
  SyntheticRecording recording(
      plain_bench::bench_of_room(geometry, R"({"value": 4, "u": 0.4})"),
      [stops, thing, seed](const fit::CaptureInfo& capture, std::int64_t seq, auto& range, auto& counts) {
        const auto stop = static_cast<std::size_t>(capture.id - 1);
        std::mt19937 random(seed + 1000 * static_cast<unsigned>(100 * stop + static_cast<std::size_t>(seq)));
        std::normal_distribution<double> normal;
        for (std::size_t k = 0; k < range.size(); ++k) {
          const double beam_deg = (static_cast<double>(k) - 180) * 0.75, stage_deg = stops[stop].true_deg;
          const auto met =
              plain_bench::look(plain_bench::room, {0, 0, 10}, stage_deg * degree, beam_deg * degree);
          double mm = met->range_mm;
          if (thing)
            mm = thing(static_cast<int>(stop), seq, std::remainder(beam_deg + 10 + stage_deg, 360.0), mm)
                     .value_or(mm);
          range[k] = static_cast<std::uint16_t>(mm > 0 ? std::lround(mm + 4 * normal(random)) : 0);
          counts[k] = static_cast<std::uint16_t>(3e6 * std::cos(met->incidence_rad) / met->range_mm);
        }
      });
  for (std::size_t i = 0; i < stops.size(); ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = stops[i].stated_deg * degree;
    if (stops[i].says_deg) capture.stage_readback_rad = *stops[i].says_deg * degree;
    capture.approach = 1;
    capture.since_power_on_s = 1500 + 40.0 * static_cast<double>(i);
    capture.last_step = 360;
    recording.add(capture, scans);
  }
  return recording;
}

bool notes(const Explanation& e, const std::string& text) {
  return std::ranges::any_of(e.notes,
                             [&](const std::string& note) { return note.find(text) != std::string::npos; });
}

}  // namespace

TEST_CASE("somebody who stands before a wall for a while is told, and is no physics of the lidar") {
  const double before_mm = GENERATE(300.0, 1000.0);
  // A body that steps aside in one stop, and stays all the time in the next.
  const Thing body = [before_mm](int stop, std::int64_t seq, double bearing_deg,
                                 double wall_mm) -> std::optional<double> {
    if (stop != 4 && stop != 5) return {};
    const double aside_deg = bearing_deg - 100 - (stop == 4 ? 1.5 * static_cast<double>(seq) : 0);
    if (std::abs(aside_deg) > 6 || (stop == 4 && seq > 6)) return {};
    return wall_mm - before_mm + 3 * aside_deg * aside_deg;
  };
  const SyntheticRecording recording = recorded(stops_all_round(12), 10, body, 1);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
  CHECK(notes(e, "Something stood before the targets in 2 captures"));
}

TEST_CASE("a readback that stands still while the stage turns is told, and one within its noise is not") {
  std::vector<Stop> stops = stops_all_round(12);
  for (std::size_t i = 0; i < stops.size(); ++i)
    stops[i].says_deg = i < 8 ? stops[i].stated_deg + (i % 2 == 0 ? 0.01 : -0.01) : stops[7].stated_deg;
  const SyntheticRecording recording = recorded(stops, 10, {}, 6);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
  CHECK(notes(e, "The stage says elsewhere in 4 captures: capture 9 was sent to"));
}

TEST_CASE("what goes through a slit at a room's corner is no echo lost") {
  const Thing slit = [](int stop, std::int64_t seq, double bearing_deg, double) -> std::optional<double> {
    std::mt19937 random(static_cast<unsigned>(100 * stop + seq));
    const double corner_deg = std::atan2(3100, 2300) / degree,
                 jitter_deg = 0.05 * std::normal_distribution<double>()(random);
    if (std::abs(bearing_deg + jitter_deg - corner_deg) > 0.1) return {};
    return 0;
  };
  const SyntheticRecording recording = recorded(stops_all_round(24), 10, slit, 4);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
}

TEST_CASE("through a pane of glass or an open door no echo is lost, and the bench file lacks it") {
  const double behind_mm = GENERATE(0.0, 1500.0);
  const Thing opening = [behind_mm](int stop, std::int64_t, double bearing_deg,
                                    double wall_mm) -> std::optional<double> {
    const bool is_open = behind_mm == 0 || (stop > 3 && stop < 9);
    if (!is_open || bearing_deg < 70 || bearing_deg > 82) return {};
    return behind_mm > 0 ? wall_mm + behind_mm : 0;
  };
  const SyntheticRecording recording = recorded(stops_all_round(12), 10, opening, 5);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
  CHECK(notes(e, "Beams go through target 'north'"));
}

TEST_CASE(
    "a plate on a wall, a niche in it, and a door ajar are told with their places, and are no physics") {
  struct Case {
    std::string says;
    double near_mm, far_mm;  // out of the wall, from one end to the other
    int from_stop;
  };
  const Case is = GENERATE(Case{"Something stands 6", 60, 60, 0}, Case{"mm behind target", -250, -250, 0},
                           Case{"Something stands", 5, 110, 6});
  const Thing thing = [is](int stop, std::int64_t, double bearing_deg,
                           double wall_mm) -> std::optional<double> {
    constexpr double from_deg = 66, to_deg = 84;
    const double along = (bearing_deg - from_deg) / (to_deg - from_deg);
    if (stop < is.from_stop || along < 0 || along > 1) return {};
    return wall_mm - (is.near_mm + along * (is.far_mm - is.near_mm));
  };
  const SyntheticRecording recording = recorded(stops_all_round(12), 10, thing, 7);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(is.says << ": " << to_text(e));
  CHECK(e.mechanisms.empty());
  CHECK(e.undecided_between.empty());
  if (is.near_mm == is.far_mm) CHECK(e.verdict == "nothing-missing");  // beside a hinge a little is left
  CHECK(notes(e, is.says));
}

TEST_CASE("what stands before the targets all the time is told with its place") {
  const double radius_mm = GENERATE(120.0, 380.0);  // the latter hides more than a quarter of a wall
  const plain_bench::PlainScene scene{.walls = plain_bench::l_shaped};
  plain_bench::PlainScene there = scene;
  there.posts.push_back({{900, -700}, radius_mm});
  SyntheticRecording recording = plain_bench::recorded(
      there, 7, [](double, double, double) { return plain_bench::Deviation{}; }, {}, scene);
  plain_bench::turn_round(recording, scene);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
  REQUIRE(notes(e, "Something stood before the targets"));
  // Its front, as most captures see it, within its radius.
  CHECK(notes(e, "mm. Add it to the bench file"));
  const std::string text = to_text(e);
  const std::size_t at = text.find("x = ");
  REQUIRE(at != std::string::npos);
  CHECK(std::abs(std::stod(text.substr(at + 4)) - 900) < radius_mm + 30);
  CHECK(std::abs(std::stod(text.substr(text.find("y = ", at) + 4)) + 700) < radius_mm + 30);
}

TEST_CASE("a wall that is written in metres is missed by its name, and all others are used") {
  const plain_bench::PlainScene scene{.walls = plain_bench::furnished};
  for (const std::size_t wall : {std::size_t{0}, std::size_t{4}}) {
    plain_bench::PlainScene written = scene;
    written.walls[wall].from /= 1000;
    written.walls[wall].to /= 1000;
    SyntheticRecording recording = plain_bench::recorded(
        scene, 8, [](double, double, double) { return plain_bench::Deviation{}; }, {}, written);
    plain_bench::turn_round(recording, scene);
    const Explanation e = fit::explain::explain({&recording}, {});
    INFO(to_text(e));
    CHECK(e.verdict == "unknown-physics");
    REQUIRE(e.unknown);
    CHECK(to_text(e).find("Bench file and recording do not agree: hardly a beam meets target 'wall " +
                          std::to_string(wall + 1) + "'") != std::string::npos);
    CHECK(e.mechanisms.empty());
  }
}

TEST_CASE("a board in the open that was never put up is missed by its name, and no light hides it") {
  const plain_bench::PlainScene written{.walls = {{{1500, -400}, {1500, 400}},
                                                  {{400, 1700}, {-400, 1650}},
                                                  {{-1200, 300}, {-1250, -300}},
                                                  {{-300, -1900}, {300, -1900}}}};
  plain_bench::PlainScene scene = written;
  scene.walls.erase(scene.walls.begin() + 1);
  SyntheticRecording recording = plain_bench::recorded(
      scene, 9, [](double, double, double) { return plain_bench::Deviation{}; }, {}, written);
  plain_bench::turn_round(recording, scene);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(to_text(e).find("hardly a beam meets target 'wall 2'") != std::string::npos);
  CHECK(e.mechanisms.empty());
  CHECK(e.undecided_between.empty());
}

TEST_CASE("a board that was carried away for a while is missed, and nothing is named for it") {
  plain_bench::PlainScene scene{
      .walls = plain_bench::furnished, .steps = 271, .front_step = 135, .step_deg = 1};
  scene.u_mm = scene.u_mount_mm = 0.01;
  scene.u_deg = scene.u_yaw_deg = 0.001;
  plain_bench::PlainScene without = scene;
  without.walls.pop_back();
  const auto nothing = [](double, double, double) { return plain_bench::Deviation{}; };
  const SyntheticRecording full = plain_bench::recorded(scene, 6, nothing),
                           bare = plain_bench::recorded(without, 6, nothing);
  SyntheticRecording recording(
      full.bench(), [&](const fit::CaptureInfo& capture, std::int64_t seq, auto& range, auto& counts) {
        (capture.id > 4 && capture.id < 8 ? bare : full).maker()(capture, seq, range, counts);
      });
  plain_bench::turn_round(recording, scene);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
  CHECK(notes(e, "it was not there"));
}

TEST_CASE("a board before a room's corner, where one wall is darker than the next, is no wide beam") {
  // Beams without any width: behind the board's edge lie 2 deg of a dark wall, then the corner.
  plain_bench::PlainScene scene{.walls = plain_bench::room, .step_deg = 0.25};
  scene.steps = 1081;
  scene.front_step = 540;
  scene.walls.push_back({{1321, 1148}, {1092, 1368}});
  SyntheticRecording dark =
      plain_bench::recorded(scene, 5, [](double, double, double) { return plain_bench::Deviation{}; });
  SyntheticRecording recording(
      dark.bench(), [&](const fit::CaptureInfo& capture, std::int64_t seq, auto& range, auto& counts) {
        dark.maker()(capture, seq, range, counts);
        for (std::size_t k = 0; k < range.size(); ++k) {
          const auto met =
              plain_bench::look(scene, {}, capture.stage_rad, (static_cast<double>(k) - 540) * 0.25 * degree);
          constexpr std::array reflectance{0.25, 0.9, 0.5, 0.5, 0.6};
          if (met) counts[k] = static_cast<std::uint16_t>(counts[k] * reflectance.at(met->wall));
        }
      });
  plain_bench::turn_round(recording, scene);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
}

TEST_CASE("two captures that were exchanged are told and left out") {
  std::vector<Stop> stops = stops_all_round(12);
  std::swap(stops[3].stated_deg, stops[5].stated_deg);
  const SyntheticRecording recording = recorded(stops, 10, {}, 2);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
  CHECK(notes(e, "capture 4 fits with the stage at 90 deg, not at 150"));
  CHECK(notes(e, "capture 6 fits with the stage at 150 deg, not at 90"));
}

TEST_CASE("boards in the open seen from a stop that was mistyped by a step of the grid move nowhere") {
  // From 15 deg aside one board stands about where another should.
  plain_bench::PlainScene scene{.walls = {{{1400, -300}, {1400, 300}},
                                          {{-300, 1800}, {500, 2100}},
                                          {{-1100, -400}, {-1500, 300}},
                                          {{500, -700}, {1100, -1000}}},
                                .steps = 1081,
                                .front_step = 540,
                                .step_deg = 0.25};
  const SyntheticRecording seen =
      plain_bench::recorded(scene, 8, [](double, double, double) { return plain_bench::Deviation{}; });
  const auto is_exchanged = GENERATE(false, true);
  const auto stated_deg = [&](int stop) { return 15.0 * (stop - 6); };
  const auto true_deg = [&](int stop) {
    if (is_exchanged) return stated_deg(stop == 3 ? 4 : stop == 4 ? 3 : stop);
    return stated_deg(stop) - (stop == 8 ? 15 : 0);
  };
  SyntheticRecording recording(seen.bench(),
                               [&](fit::CaptureInfo capture, std::int64_t seq, auto& range, auto& counts) {
                                 capture.stage_rad = true_deg(static_cast<int>(capture.id) - 1) * degree;
                                 seen.maker()(capture, seq, range, counts);
                               });
  for (int stop = 0; stop < 13; ++stop) {
    fit::CaptureInfo capture;
    capture.stage_rad = stated_deg(stop) * degree;
    capture.approach = 1;
    capture.last_step = scene.steps - 1;
    capture.since_power_on_s = 1800 + 20 * stop;
    recording.add(capture, 10);
  }
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.verdict == "nothing-missing");
  CHECK(notes(e, is_exchanged ? "capture 4 fits with the stage at -30 deg, not at -45"
                              : "capture 9 fits with the stage at 15 deg, not at 30"));
}

TEST_CASE("a stage that slips by a degree half way moves nothing else") {
  std::vector<Stop> stops = stops_all_round(12);
  for (std::size_t i = 6; i < stops.size(); ++i) stops[i].true_deg += 1;
  const SyntheticRecording recording = recorded(stops, 5, {}, 3);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  // By a lidar that turned on the stage, or the stage itself.
  const bool by_mount = e.mechanisms.size() == 1 && e.mechanisms.front().mechanism->id == "mount-moved" &&
                        !e.unknown,
             by_stage = e.mechanisms.empty() && e.unknown &&
                        e.unknown->describes.starts_with("the stage angle steps by ") &&
                        e.unknown->describes.find(" deg at time_s = 17") != std::string::npos;
  if (by_stage)
    CHECK(std::stod(e.unknown->describes.substr(std::string("the stage angle steps by ").size())) ==
          Approx(1).margin(0.02));
  CHECK((by_mount || by_stage));
}

TEST_CASE("a stage that slips by several degrees half way has no mistyped captures", "[long]") {
  std::vector<Stop> stops = stops_all_round(9);
  for (std::size_t i = 5; i < stops.size(); ++i) stops[i].true_deg += 4;
  const SyntheticRecording recording = recorded(stops, 5, {}, 3);
  const Explanation e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK_FALSE(notes(e, "What is recorded of where things stood is wrong"));
  CHECK(e.verdict != fit::explain::nothing_missing);
}

TEST_CASE("a knock is looked for while the session was recorded") {
  const SyntheticRecording recording = recorded(stops_all_round(8), 10, {}, 4);
  fit::explain::Reduced reduced = fit::explain::reduce(recording, {});
  const auto placed = fit::explain::inference::fit_placements(reduced, {});
  const fit::explain::inference::Session session(reduced, {}, placed.there);
  const auto kind = std::ranges::find_if(session.kinds(),
                                         [](const auto& one) { return one.mechanism->id == "mount-moved"; });
  REQUIRE(kind != session.kinds().end());
  for (const auto& values : kind->starts) {
    CHECK(values.back() > 1500);
    CHECK(values.back() < 1500 + 40.0 * 7 + 1);
  }
}

}  // namespace explain_careless_test
