// SPDX-License-Identifier: MIT
// Rooms, stages, lidars and operators as they are: walls that are not flat, worms of many teeth, noise that
// remembers, echoes that are lost now and then, beams that are dead, knocks.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "fit/explain/explanation.hpp"
#include "fit/explain/reduction/left_out.hpp"
#include "plain_room.hpp"

namespace explain_as_they_are_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;
using plain_bench::Deviation;

struct Device {
  std::function<double(double x_mm, double y_mm)> wall_mm = [](double, double) { return 0.0; };
  /// Of a wall, out along its normal, at that time.
  std::function<double(double x_mm, double y_mm, double time_s)> out_mm = [](double, double, double) {
    return 0.0;
  };
  std::function<plain_bench::Mount(double time_s)> mount = [](double) { return plain_bench::Mount{}; };
  std::function<bool(int beam)> is_dead = [](int) { return false; };
  std::function<double(double stage_rad)> stage_rad = [](double) { return 0.0; };
  std::function<double(double time_s)> stage_drift_rad = [](double) { return 0.0; };
  /// What a beam delivers instead of what it measured, mm.
  std::function<double(int beam, double time_s, double mm)> delivers = [](int, double, double mm) {
    return mm;
  };
  /// Scans come again, or break off.
  std::function<bool(std::int64_t seq)> is_again = [](std::int64_t) { return false; };
  std::function<int(std::int64_t seq)> beams_of = [](std::int64_t) { return 1000; };
  /// Of the light that a usual wall sends back; none: no intensities.
  std::function<double(double x_mm, double y_mm)> grey = {};
  double odd_beams_mm = 0;  ///< Every other beam reads that much long.
  double rho = 0;           ///< Of its noise, from scan to scan.
  double lost = 0;          ///< Share of echoes.
};

/// The room from 16 stage angles that keep no step; `beside`: and once more in another session, whose time
/// counts anew.
Explanation explained(const Device& device, long scans, const Device* beside = nullptr) {
  constexpr double sigma_mm = 3;
  const fit::Bench bench = plain_bench::bench_of_room(R"("steps": 271, "front_step": 135, "step_deg": 1)",
                                                      R"({"value": 3, "u": 0.3})");
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> share(0, 1);
  std::vector<double> noise(271, 0.0);
  const auto scan_of = [&](const Device& one, const fit::CaptureInfo& capture, std::int64_t seq,
                           std::vector<std::uint16_t>& range, std::vector<std::uint16_t>& intensity) {
    if (one.is_again(seq)) return;  // it is as it was
    for (std::size_t k = 0; k < range.size(); ++k) {
      const double beam = (static_cast<double>(k) - 135) * degree, rho = seq == 0 ? 0 : one.rho;
      noise[k] = rho * noise[k] + std::sqrt(1 - rho * rho) * sigma_mm * normal(random);
      const double time_s = *capture.since_power_on_s;
      const auto met =
          plain_bench::look(plain_bench::room, one.mount(time_s), capture.stage_rad, beam,
                            {.stage_rad = one.stage_rad(capture.stage_rad) +
                                          one.stage_drift_rad(time_s + 0.025 * static_cast<double>(seq))});
      const double bearing = capture.stage_rad + beam, x = met->range_mm * std::cos(bearing),
                   y = met->range_mm * std::sin(bearing),
                   wall = one.wall_mm(x, y) + one.out_mm(x, y, time_s) / std::cos(met->incidence_rad);
      if (one.grey)
        intensity[k] = static_cast<std::uint16_t>(
            std::lround(one.grey(x, y) * 3e6 * std::cos(met->incidence_rad) / met->range_mm));
      const int at = static_cast<int>(k);
      const double mm = met->range_mm + wall + noise[k] + (k % 2 != 0 ? one.odd_beams_mm : 0);
      range[k] = one.is_dead(at) || share(random) < one.lost || at >= one.beams_of(seq)
                     ? std::uint16_t{0}
                     : static_cast<std::uint16_t>(std::lround(one.delivers(at, time_s, mm)));
    }
  };
  const auto recorded_by = [&](const Device& one) {
    return SyntheticRecording(bench, [&](const fit::CaptureInfo& capture, std::int64_t seq, auto& range,
                                         auto& intensity) { scan_of(one, capture, seq, range, intensity); });
  };
  SyntheticRecording recording = recorded_by(device), other = recorded_by(beside ? *beside : device);
  for (int i = 0; i < 16; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = std::remainder(138.7 * i + 37 * std::sin(5.0 * i), 360) * degree;
    capture.approach = 1;
    capture.last_step = 270;
    capture.since_power_on_s = 100 + 20 * i;
    recording.add(capture, scans);
    other.add(capture, scans);
  }
  if (beside) return fit::explain::explain({&recording, &other}, {});
  return fit::explain::explain({&recording}, {});
}

}  // namespace

TEST_CASE("a wall that is not flat is told by its place on it, and nothing is named instead") {
  const Explanation e = explained(
      {.wall_mm = [](double x,
                     double y) { return y > 3000 ? 5 * std::exp(-0.5 * std::pow((x + 300) / 250, 2)) : 0; }},
      12);
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  REQUIRE(e.unknown);
  CHECK(e.unknown->coordinate == fit::Coordinate::target);
  CHECK_THAT(e.unknown->describes, Catch::Contains("along target 'north'"));
}

TEST_CASE("a piece of a wall that stands out is told with its ends, and its other grey makes no walk of it") {
  const auto is_on_it = [](double x, double y) { return y > 2000 && std::abs(x + 300) < 350; };
  const Explanation e =
      explained({.out_mm = [&](double x, double y, double) { return is_on_it(x, y) ? -12 : 0; },
                 .grey = [&](double x, double y) { return is_on_it(x, y) ? 0.3 : 1; }},
                12);
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  CHECK(e.undecided_between.empty());
  REQUIRE(e.unknown);
  CHECK_THAT(e.unknown->describes, Catch::StartsWith("a piece of target 'north', from 2") &&
                                       Catch::Contains(" lies 12.") &&
                                       Catch::Contains("mm nearer than the rest of it"));
  CHECK(e.curves.front().target == "north");
}

TEST_CASE("a corrugated wall is told as rough, and no wave of the range is named for it", "[long]") {
  const Explanation e = explained(
      {.wall_mm = [](double x, double y) { return y > 3000 ? 5 * std::sin(2 * fit::pi * x / 230) : 0; }}, 12);
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  REQUIRE(e.unknown);
  CHECK_THAT(e.unknown->describes,
             Catch::Contains("'north' is rougher than it should be") && !Catch::Contains("'south'"));
}

TEST_CASE("walls that are all a little uneven are told as just that") {
  const Explanation e = explained(
      {.wall_mm = [](double x, double y) { return 2 * std::sin(x / 410) + 2 * std::cos(y / 530); }}, 12);
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  REQUIRE(e.unknown);
  CHECK(e.unknown->coordinate == fit::Coordinate::target);
}

TEST_CASE("a worm of many teeth is found by stops that are far apart") {
  const double period_deg = GENERATE(3.0, 2.0);
  const Explanation e =
      explained({.stage_rad =
                     [&](double stage) {
                       return 0.05 * degree * std::sin(2 * fit::pi * stage / degree / period_deg + 1);
                     }},
                12);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  REQUIRE(e.mechanisms.front().mechanism->id == "stage-periodic");
  CHECK(e.mechanisms.front().parameters.at("period_deg").value == Approx(period_deg).margin(0.01));
  CHECK(!e.unknown);
}

TEST_CASE("noise that remembers much is nothing else besides", "[long]") {
  const Explanation e = explained({.rho = 0.8}, 60);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "correlated-noise");
  CHECK(!e.unknown);
  CHECK(e.undecided_between.empty());
}

TEST_CASE("one echo in a thousand may be lost without anything missing, one in twenty may not") {
  const Explanation few = explained({.lost = 0.001}, 40), many = explained({.lost = 0.05}, 40);
  INFO(to_text(few) << to_text(many));
  CHECK(few.verdict == fit::explain::nothing_missing);
  CHECK(many.unknown);
}

TEST_CASE("beams that read off each by its own are told as that") {
  const Explanation e = explained({.odd_beams_mm = 2}, 12);
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  REQUIRE(e.unknown);
  CHECK_THAT(e.unknown->describes, Catch::Contains("every beam reads off by its own"));
}

TEST_CASE("walls that are rough as plaster is are nothing to tell") {
  // A midpoint-displacement profile along every wall, by other means than the model's: steps that halve in
  // variance with the distance, 0.3 mm at a metre.
  std::mt19937 random(23);
  std::normal_distribution<double> normal;
  std::vector<double> profile(2, 0.0);
  for (double step_mm = 0.3 * 2; profile.size() < 1000; step_mm /= std::sqrt(2.0)) {
    std::vector<double> finer;
    for (std::size_t i = 0; i + 1 < profile.size(); ++i) {
      finer.push_back(profile[i]);
      finer.push_back((profile[i] + profile[i + 1]) / 2 + step_mm / 2 * normal(random));
    }
    finer.push_back(profile.back());
    profile = finer;
  }
  const auto at = [&](double place_mm) {
    const double index =
        std::clamp((place_mm + 6000) / 12000, 0.0, 1.0) * static_cast<double>(profile.size() - 1);
    return profile[static_cast<std::size_t>(index)];
  };
  const Explanation e = explained(
      {.out_mm = [&](double x, double y, double) { return std::abs(y) > 2900 ? at(x) : at(-y + 400); }}, 40);
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  CHECK(e.verdict == fit::explain::nothing_missing);
}

TEST_CASE("bumps of a hand's breadth are no wave of the range") {
  // White noise along the walls, smoothed over 20 and 60 mm: 0.2 mm in all, and hardly any noise.
  constexpr double step_mm = 5;
  std::mt19937 random(29);
  std::normal_distribution<double> normal;
  std::vector<double> white(2600), profile(2400);
  for (double& value : white) value = normal(random);
  for (const double width_mm : {20.0, 60.0}) {
    const double share_mm = 0.14 * std::sqrt(step_mm / (width_mm * std::sqrt(fit::pi)));
    for (std::size_t i = 0; i < profile.size(); ++i)
      for (int k = -100; k <= 100; ++k)
        profile[i] += share_mm * white[i + static_cast<std::size_t>(k + 100)] *
                      std::exp(-0.5 * std::pow(k * step_mm / width_mm, 2));
  }
  const auto at = [&](double place_mm) {
    return profile[static_cast<std::size_t>(std::clamp((place_mm + 6000) / step_mm, 0.0, 2399.0))];
  };
  const Explanation e = explained(
      {.out_mm = [&](double x, double y, double) { return std::abs(y) > 2900 ? at(x) : at(-y + 400); }}, 100);
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  // Roughness, or the shape of a wall: both are true.
  CHECK((e.verdict == fit::explain::nothing_missing ||
         (e.unknown && e.unknown->coordinate == fit::Coordinate::target)));
}

TEST_CASE("a lidar that is knocked about while it runs is told as that, with its time") {
  const Explanation e =
      explained({.mount =
                     [](double time_s) {
                       return time_s < 250 ? plain_bench::Mount{} : plain_bench::Mount{2, -1.5, 0.15};
                     }},
                12);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  REQUIRE(e.mechanisms.front().mechanism->id == "mount-moved");
  const auto& found = e.mechanisms.front().parameters;
  CHECK(found.at("from_s").value > 240);
  CHECK(found.at("from_s").value < 260);
  CHECK(found.at("x_mm").value == Approx(2).margin(4 * found.at("x_mm").u));
  CHECK(found.at("y_mm").value == Approx(-1.5).margin(4 * found.at("y_mm").u));
  CHECK(found.at("yaw_deg").value == Approx(0.15).margin(4 * found.at("yaw_deg").u));
  CHECK(found.at("x_mm").u < 0.3);
  CHECK(!e.unknown);
  for (const auto& description : e.predictor.descriptions) {
    CHECK(description.mechanisms.empty());  // it happened once, and in no other recording
    CHECK(description.constant.mm == Approx(3).margin(0.1));
  }
}

TEST_CASE("a curtain that hangs elsewhere every time is told as that, and moves nothing else") {
  const Explanation e = explained({.out_mm =
                                       [](double, double y, double time_s) {
                                         if (y < 3099.9) return 0.0;
                                         std::mt19937 random(static_cast<unsigned>(std::lround(time_s)));
                                         random.discard(10);
                                         return 1.5 * std::normal_distribution<double>()(random);
                                       }},
                                  30);
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  CHECK(e.undecided_between.empty());
  REQUIRE(e.unknown);
  CHECK_THAT(e.unknown->describes,
             Catch::StartsWith("target 'north' stands elsewhere from capture to capture"));
  CHECK_THAT(e.unknown->describes, !Catch::Contains("; and"));
}

TEST_CASE("a wall that is pushed and put back is told as that") {
  const Explanation e = explained(
      {.out_mm = [](double, double y,
                    double time_s) { return y > 3099.9 && time_s > 170 && time_s < 270 ? -4.0 : 0.0; }},
      12);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  REQUIRE(e.mechanisms.front().mechanism->id == "target-moved");
  CHECK(e.mechanisms.front().target == "north");
  const auto& found = e.mechanisms.front().parameters;
  CHECK(found.at("offset_mm").value == Approx(-4).margin(0.5));
  CHECK(found.at("from_s").value == Approx(170).margin(10));
  CHECK(found.at("to_s").value == Approx(270).margin(10));
}

TEST_CASE("a wall that is pushed in one session is told as that beside another one in which it is not") {
  const Device pushed{
      .out_mm = [](double, double y,
                   double time_s) { return y > 3099.9 && time_s > 170 && time_s < 270 ? -4.0 : 0.0; }},
      still;
  const Explanation e = explained(pushed, 12, &still);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  REQUIRE(e.mechanisms.front().mechanism->id == "target-moved");
  const auto& found = e.mechanisms.front().parameters;
  CHECK(found.at("offset_mm").value == Approx(-4).margin(0.5));
  CHECK(found.at("from_s").value == Approx(170).margin(10));
  CHECK(found.at("to_s").value == Approx(270).margin(10));
  CHECK_THAT(to_text(e), Catch::Contains("one after the other"));
}

TEST_CASE("beams that return nothing wherever they look are left out, and are no light and no weak echo") {
  const Explanation e =
      explained({.is_dead = [](int beam) { return beam == 60 || (beam > 180 && beam < 185); }}, 12);
  INFO(to_text(e));
  CHECK(e.verdict == fit::explain::nothing_missing);
  CHECK_THAT(to_text(e), Catch::Contains("-75 deg") && Catch::Contains("46 to 49 deg"));
}

TEST_CASE(
    "a beam that delivers what another one saw, or reads long, is left out, and nothing is named for it") {
  const double from_s = GENERATE(0.0, 250.0);  // at all times, or in the second half
  const Explanation e = explained({.delivers =
                                       [&](int beam, double time_s, double mm) {
                                         if (time_s < from_s) return mm;
                                         return beam == 0 ? 6000 - mm : beam == 100 ? mm + 60 : mm;
                                       }},
                                  12);
  INFO(to_text(e));
  CHECK(e.verdict == fit::explain::nothing_missing);
  CHECK_THAT(to_text(e), Catch::Contains("Beams at -135 deg and -35 deg read far otherwise"));
}

TEST_CASE("ranges that all end at one number are told as a limit, and are nothing that stood there") {
  const Explanation e =
      explained({.delivers = [](int, double, double mm) { return std::min(mm, 3400.0); }}, 12);
  INFO(to_text(e));
  CHECK(e.verdict == "unknown-physics");
  CHECK(e.mechanisms.empty());
  CHECK(e.undecided_between.empty());
  CHECK_THAT(to_text(e), Catch::Contains("no range is longer than 3400 mm") &&
                             !Catch::Contains("Something stood before"));
}

TEST_CASE("a beam that reads far otherwise is found wherever no edge is near it") {
  constexpr std::size_t beams = 9, stops = 4, odd = 4;
  for (const double to_edge_rad : {0.5, 0.01}) {
    fit::explain::Reduced reduced;
    for (std::size_t stop = 0; stop < stops; ++stop) {
      fit::explain::Group group;
      group.stage_rad = 0.2 * static_cast<double>(stop);
      group.first_cell = reduced.cells.size();
      for (std::size_t i = 0; i < beams; ++i) {
        fit::explain::Cell cell;
        cell.group = static_cast<int>(stop);
        cell.beam_rad = static_cast<double>(i) * degree;
        cell.n = 20;
        cell.usable = true;
        cell.edge = 0;  // the nearest one, wherever it is
        cell.at.edge_rad = to_edge_rad;
        cell.at.target = 0;
        cell.nominal_mm = 2000;
        cell.mean_mm = 2000 + (i == odd ? 80 : 0.1 * static_cast<double>(i % 2));
        reduced.cells.push_back(cell);
      }
      group.last_cell = reduced.cells.size();
      reduced.groups.push_back(group);
    }
    const auto found = fit::explain::reduction::leave_out_odd_beams(reduced);
    INFO(to_edge_rad);
    CHECK(found.size() == (to_edge_rad > 0.1 ? 1 : 0));
    CHECK(reduced.cells[odd].usable == (to_edge_rad < 0.1));
  }
}

TEST_CASE("a wall with a nail in it has no broken beam: another one sees it from each stop") {
  const Explanation e = explained(
      {.wall_mm = [](double x, double y) { return y > 2000 && std::abs(x - 200) < 30 ? -40 : 0; }}, 12);
  INFO(to_text(e));
  CHECK_THAT(to_text(e), !Catch::Contains("read far otherwise"));
}

TEST_CASE("scans that come twice, or break off, are told, and are neither noise that remembers nor light") {
  const Explanation twice = explained({.is_again = [](std::int64_t seq) { return seq % 3 == 2; }}, 40);
  INFO(to_text(twice));
  CHECK(twice.verdict == fit::explain::nothing_missing);
  CHECK_THAT(to_text(twice), Catch::Contains("Scans came more than once"));
  const Explanation broken =
      explained({.beams_of = [](std::int64_t seq) { return seq % 17 == 5 ? 180 : 1000; }}, 40);
  INFO(to_text(broken));
  CHECK(broken.verdict == fit::explain::nothing_missing);
  CHECK_THAT(to_text(broken), Catch::Contains("of the scans have gaps"));
}

TEST_CASE("a stage whose zero drifts is told as that, on whatever grid of stops") {
  const Explanation e =
      explained({.stage_drift_rad = [](double time_s) { return 1e-3 * degree * (time_s - 250); }}, 12);
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  REQUIRE(e.unknown);
  CHECK_THAT(e.unknown->describes, Catch::StartsWith("the stage angle grows evenly along time_s, by 0.3"));
}

TEST_CASE("noise that is skewed or has two peaks is unknown physics, and heavy tails are not") {
  std::mt19937 random(23);
  std::exponential_distribution<double> late;
  std::student_t_distribution<double> heavy(5);
  const auto with = [&](const std::function<double()>& more) {
    const Explanation e = explained({.delivers = [&](int, double, double mm) { return mm + more(); }}, 25);
    return e.unknown ? e.unknown->describes : std::string();
  };
  CHECK_THAT(with([&] { return 6 * (late(random) - 1); }),
             Catch::Contains("scatter farther to the long side") && Catch::Contains("is 1."));
  CHECK_THAT(with([&] { return random() % 2 == 0 ? 6.0 : -6.0; }), Catch::Contains("about two values"));
  CHECK(with([&] { return 3 * heavy(random); }).empty());
}

TEST_CASE("a stage that vibrates all the time does not settle, and its frequency is told") {
  constexpr double hz = 7.31;
  const Explanation e = explained(
      {.stage_drift_rad = [&](double time_s) { return 0.15 * degree * std::sin(2 * fit::pi * hz * time_s); }},
      60);
  INFO(to_text(e));
  REQUIRE(e.unknown);
  CHECK_THAT(e.unknown->describes, Catch::StartsWith("the stage's angle swings by 0.15 deg at 7.3"));
  // Nothing but what scans draw, where it is not known for a wave.
  for (const auto& found : e.mechanisms) CHECK(found.mechanism->id == "angle-jitter");
}

}  // namespace explain_as_they_are_test
