// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "fit/explain/explanation.hpp"
#include "plain_room.hpp"
#include "tests/support/rounds.hpp"

namespace light_and_lamps_test {
namespace {

using fit::explain::Explanation;
using plain_bench::degree;

/// What light does to one sample.
struct Light {
  double range_mm = 0;    ///< Added to it.
  double scatter_mm = 0;  ///< Its own noise besides the lidar's.
  double lost = 0;        ///< Probability of no echo.
  double slant_mm = 0;    ///< Noise of surfaces at 45 deg and 1 m, by range and tangent of the incidence.
};

/// At a beam angle (deg), a time since power-on and the time of the beam itself (s).
using OfLight = std::function<Light(double beam_deg, double time_s, double beam_time_s)>;

constexpr int captures = 16;
constexpr double first_s = 100, every_s = 40.3;

double stage_deg(int capture) { return 45.0 * (capture < 8 ? capture : captures - 1 - capture); }

/// A room seen from 16 stage angles, both ways, 40 s apart, in steps of the range.
Explanation explained(const OfLight& light, int scans = 10, unsigned seed = 1, double step_mm = 1) {
  const fit::Bench bench = plain_bench::bench_of_room(
      R"("steps": 361, "front_step": 180, "step_deg": 0.75, "mount": {"x_mm": {"value": 0, "u": 3},
    "y_mm": {"value": 0, "u": 3}, "yaw_deg": {"value": 10, "u": 0.3}})",
      R"({"value": 4, "u": 0.4})");
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> chance;
  SyntheticRecording recording(bench, [&](const fit::CaptureInfo& capture, std::int64_t seq, auto& range,
                                          auto& counts) {
    for (std::size_t k = 0; k < range.size(); ++k) {
      const double beam_deg = (static_cast<double>(k) - 180) * 0.75;
      const double time_s = *capture.since_power_on_s + 0.025 * static_cast<double>(seq);
      const auto met = plain_bench::look(plain_bench::room, {0, 0, 10}, capture.stage_rad, beam_deg * degree);
      const Light is = light(beam_deg, time_s, time_s + (beam_deg + 135) / 14400);
      const double slant_mm = is.slant_mm * std::tan(met->incidence_rad) * met->range_mm / 1000,
                   mm = met->range_mm + is.range_mm + std::hypot(4, is.scatter_mm, slant_mm) * normal(random);
      const bool seen = chance(random) >= is.lost;
      range[k] = seen ? static_cast<std::uint16_t>(std::lround(step_mm * std::round(mm / step_mm)))
                      : std::uint16_t{0};
      counts[k] = seen ? static_cast<std::uint16_t>(3e6 * std::cos(met->incidence_rad) / met->range_mm)
                       : std::uint16_t{0};
    }
  });
  for (int i = 0; i < captures; ++i) {
    fit::CaptureInfo capture;
    capture.stage_rad = stage_deg(i) * degree;
    capture.approach = i < 8 ? 1 : -1;
    capture.since_power_on_s = first_s + every_s * i;
    capture.last_step = 360;
    recording.add(capture, scans);
  }
  return fit::explain::explain({&recording}, {});
}

bool is_located(const Explanation& e, fit::Coordinate coordinate, double from, double to, double within) {
  return std::ranges::any_of(e.located, [&](const fit::explain::Located& l) {
    return l.coordinate == coordinate && std::abs(l.from - from) < within && std::abs(l.to - to) < within;
  });
}

}  // namespace

TEST_CASE("the sun that comes in for a few captures is reported with its beams and its times") {
  // From -20 to 20 deg in the captures from 260 to 430 s.
  const Explanation e = explained([](double beam_deg, double time_s, double) {
    const bool shines = std::abs(beam_deg) < 20 && time_s > 255 && time_s < 435;
    return Light{.scatter_mm = shines ? 6.0 : 0};
  });
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  const auto& found = e.mechanisms.front();
  CHECK(found.mechanism->id == "sunlight");
  CHECK(std::abs(found.parameters.at("centre_deg").value) < 4);
  CHECK(found.parameters.at("from_s").value == Approx(255).margin(25));
  CHECK(found.parameters.at("to_s").value == Approx(435).margin(25));
  CHECK(e.undecided_between.empty());
  CHECK_FALSE(e.unknown);
  CHECK(is_located(e, fit::Coordinate::time, 255, 435, 25));
  CHECK(is_located(e, fit::Coordinate::beam, -20, 20, 8));
}

TEST_CASE("noise of one capture only, over some beams, is light at these beams and that time") {
  const Explanation e = explained([](double beam_deg, double time_s, double) {
    const bool shines = beam_deg > 30 && beam_deg < 60 && time_s > 300 && time_s < 304;
    return Light{.scatter_mm = shines ? 9.0 : 0};
  });
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "sunlight");
  CHECK_FALSE(e.unknown);
  CHECK(is_located(e, fit::Coordinate::time, 301.5, 301.5, 25));
  CHECK(is_located(e, fit::Coordinate::beam, 30, 60, 8));
}

TEST_CASE("light that ends sharply is light, and no function is left of its ends") {
  const auto sharp = [](double beam_deg, double, double) {
    const bool shines = beam_deg > 20 && beam_deg < 60;
    return Light{.scatter_mm = shines ? 4.0 : 0, .lost = shines ? 0.03 : 0};
  };
  const Explanation e = explained(sharp, 20, 3);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  const auto& found = e.mechanisms.front();
  CHECK(found.mechanism->id == "sunlight");
  CHECK(std::abs(found.parameters.at("centre_deg").value - 40) < 2);
  CHECK(std::abs(found.parameters.at("width_deg").value - 20) < 3);
  CHECK_FALSE(e.unknown);
}

TEST_CASE("light with a profile of its own is light, and nothing else") {
  // The noise itself, not its variance, is brightest in the middle by a bell.
  const auto shone = [](double beam_deg, double, double) {
    const double bell = std::exp(-std::pow((beam_deg + 50) / 25, 2) / 2);
    return Light{.scatter_mm = 4 * std::sqrt(std::pow(1 + 1.9 * bell, 2) - 1), .lost = 0.03 * bell};
  };
  const Explanation e = explained(shone, 20, 5);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "sunlight");
  CHECK(std::abs(e.mechanisms.front().parameters.at("centre_deg").value + 50) < 3);
  CHECK_FALSE(e.unknown);
}

TEST_CASE("noise at all angles for a while is unknown physics at that time, and no noise of the lidar") {
  const Explanation e = explained([](double, double time_s, double) {
    return Light{.scatter_mm = time_s > 255 && time_s < 435 ? 4.0 : 0};
  });
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  CHECK(e.undecided_between.empty());
  REQUIRE(e.unknown);
  CHECK(e.unknown->coordinate == fit::Coordinate::time);
  constexpr double between_captures_s = 40.3;  // anywhere there is the same
  CHECK(is_located(e, fit::Coordinate::time, 255, 435, between_captures_s));
}

TEST_CASE("echoes that light hides for a while are sunlight at these beams and times, and no weak echoes",
          "[long]") {
  const Explanation e = explained([](double beam_deg, double time_s, double) {
    const bool shines = std::abs(beam_deg - 40) < 14 && time_s > 255 && time_s < 435;
    return Light{.lost = shines ? 0.2 : 0};
  });
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "sunlight");
  CHECK(is_located(e, fit::Coordinate::time, 255, 435, 25));
}

TEST_CASE("a lamp's flicker is unknown physics with its frequency, and nothing else is named for it",
          "[rounds]") {
  int named = 0;
  for (const double hz : some_of<double>({100, 50, 133, 172}))
    for (unsigned seed = 1; seed <= rounds(2); ++seed) {
      const int scans = hz == 100 ? 24 : 10;
      const Explanation e = explained(
          [hz](double, double time_s, double beam_time_s) {
            // The mains is not in step with the captures.
            const double phase = 40 * std::sin(time_s - std::fmod(time_s - 100, 40.3));
            return Light{.range_mm = 2.5 * std::cos(2 * 180 * degree * hz * beam_time_s + phase)};
          },
          scans, seed);
      INFO(hz << " Hz: " << to_text(e));
      named += !e.mechanisms.empty();
      for (const auto& set : e.undecided_between) CHECK(std::ranges::count(set, "nothing-missing") == 1);
      REQUIRE(e.unknown);
      CHECK(e.verdict == "unknown-physics");
      CHECK(e.unknown->coordinate == fit::Coordinate::time);
      CHECK_THAT(e.unknown->describes, Catch::Contains("from scan to scan looks like"));
      CHECK_THAT(e.unknown->describes, Catch::Contains("ranges swing by 2."));
      const double found_hz = std::stod(e.unknown->describes.substr(e.unknown->describes.find(" at ") + 4));
      CHECK(found_hz == Approx(hz).margin(scans == 24 ? 0.5 : 1.5));
    }
  CHECK(named <= 1);  // of eight, by chance
}

/// What is named, or the only set.
std::vector<std::string> reported(const Explanation& e) {
  std::vector<std::string> names;
  for (const auto& found : e.mechanisms) names.push_back(found.mechanism->id);
  if (names.empty() && e.undecided_between.size() == 1) names = e.undecided_between.front();
  return names;
}

TEST_CASE("beams that lose echoes, and scatter as all others do, are not called light for sure", "[long]") {
  const Explanation e = explained([](double beam_deg, double, double) {
    return Light{.lost = 0.04 * std::exp(-std::pow((beam_deg + 40) / 12, 2) / 2)};
  });
  INFO(to_text(e));
  const std::vector<std::string> names = reported(e);
  REQUIRE(std::ranges::count(names, "local-loss") == 1);
  CHECK((names.size() == 1 || names.front() == "local-loss"));
  CHECK_FALSE(e.unknown);
}

TEST_CASE("slanted surfaces that scatter more without an edge in sight: echo and angle are not told apart") {
  const Explanation e = explained([](double, double, double) { return Light{.slant_mm = 2}; });
  INFO(to_text(e));
  const std::vector<std::string> names = reported(e);
  CHECK(std::ranges::count(names, "incidence-noise") == 1);
  CHECK((names.size() == 1 || std::ranges::count(names, "angle-jitter") == 1));
  CHECK(std::ranges::count(names, "nothing-missing") == 0);
}

TEST_CASE("without light nothing is reported", "[rounds]") {
  for (const unsigned seed : some_of<unsigned>({1, 2, 3})) {
    const Explanation e = explained([](double, double, double) { return Light{}; }, seed == 3 ? 24 : 8, seed);
    INFO(to_text(e));
    CHECK(e.verdict == "nothing-missing");
  }
}

TEST_CASE("coarse steps of the range make no noise of a few beams, and hide none that is clear", "[rounds]") {
  const unsigned round = GENERATE(0U, 1U, 2U, 3U);
  if (round >= rounds(8)) return;  // one in the suite
  const double step_mm = std::array{7.0, 15.7, 3.0, 10.0}[round];
  const auto shines = GENERATE(false, true);
  const Explanation e = explained(
      [shines](double beam_deg, double, double) {
        return Light{.scatter_mm = shines ? 2.2 * std::exp(-std::pow((beam_deg - 30) / 20, 2)) : 0};
      },
      10, 3, step_mm);
  INFO(step_mm << " mm: " << to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "rounding");
  CHECK(e.mechanisms.front().parameters.at("step_mm").value == Approx(step_mm).margin(0.01));
  // Light that neither comes and goes nor drowns echoes may be noise local in the beam: a set. So is a bump
  // of the same shape outside the catalogue, if less probable.
  const auto is_light = [](const std::vector<std::string>& set) {
    return set.front() == "local-noise" && std::ranges::count(set, "sunlight") == 1 &&
           std::ranges::count(set, "unknown-physics") == std::ssize(set) - 2;
  };
  const bool found = e.undecided_between.size() == 1 && is_light(e.undecided_between.front());
  // In steps of more than twice the noise, a variance says little.
  if (step_mm < 10) CHECK(found == shines);
  CHECK((shines || !found));
  for (const auto& set : e.undecided_between)
    CHECK((is_light(set) || std::ranges::count(set, "nothing-missing") == 1));
}

TEST_CASE("noise that is the same everywhere is no threshold's, where no echo is lost") {
  const Explanation e = explained([](double, double, double) { return Light{.scatter_mm = 14}; }, 40, 5);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  CHECK(e.mechanisms.front().mechanism->id == "range-noise");
  CHECK(e.undecided_between.empty());
}

TEST_CASE("light that stays in the room while the stage turns is light, and where it stands is told") {
  const Explanation e = explained(
      [](double beam_deg, double time_s, double) {
        const double stage = stage_deg(static_cast<int>((time_s - first_s) / every_s));
        const double away = std::remainder(beam_deg + stage - 170, 360.0),
                     bell = std::exp(-std::pow(away / 25, 2));
        return Light{.scatter_mm = 7 * bell, .lost = 0.04 * bell * bell};
      },
      10, 11);
  INFO(to_text(e));
  REQUIRE(e.mechanisms.size() == 1);
  const auto& found = e.mechanisms.front();
  CHECK(found.mechanism->id == "sunlight");
  CHECK(std::abs(std::remainder(found.parameters.at("centre_deg").value - 170, 360.0)) < 4);
  CHECK(found.parameters.at("in_room").value == 1);
  CHECK(e.undecided_between.empty());
  CHECK_FALSE(e.unknown);
}

TEST_CASE("a part of a wall that is rough is light, or what no mechanism makes") {
  const Explanation e = explained(
      [](double beam_deg, double time_s, double) {
        const double stage = stage_deg(static_cast<int>((time_s - first_s) / every_s));
        return Light{.scatter_mm = std::abs(std::remainder(beam_deg + stage - 170, 360.0)) < 20 ? 4.0 : 0.0};
      },
      10, 13);
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  REQUIRE(e.undecided_between.size() == 1);
  CHECK(std::ranges::count(e.undecided_between.front(), "unknown-physics") == 1);
}

TEST_CASE("two sectors of noisy beams, at all times and without losses, are not told as light for sure",
          "[long]") {
  const auto sector = [](double beam_deg, double centre_deg) {
    return std::exp(-std::pow((beam_deg - centre_deg) / 12, 2));
  };
  for (const unsigned seed : {1u, 2u}) {
    const Explanation e = explained(
        [&](double beam_deg, double, double) {
          Light is;
          is.scatter_mm = 7 * std::sqrt(sector(beam_deg, -60) + sector(beam_deg, 70));
          return is;
        },
        10, seed);
    INFO("seed " << seed << ": " << to_text(e));
    CHECK(std::ranges::none_of(
        e.mechanisms, [](const fit::explain::Found& found) { return found.mechanism->id == "sunlight"; }));
    CHECK(std::ranges::count(e.undecided_between, std::vector<std::string>{"local-noise", "sunlight"}) <= 1);
  }
}

TEST_CASE("noise that every beam has by its own is no noise of some beams, and is told") {
  std::mt19937 random(17);
  std::normal_distribution<double> normal;
  std::array<double, 361> scatter_mm{};
  for (double& one : scatter_mm) one = 4 * std::sqrt(std::max(0.0, std::exp(0.7 * normal(random)) - 0.2));
  const Explanation e = explained(
      [&](double beam_deg, double, double) {
        return Light{.scatter_mm = scatter_mm[static_cast<std::size_t>(std::lround(beam_deg / 0.75 + 180))]};
      },
      30, 19);
  INFO(to_text(e));
  for (const auto& found : e.mechanisms) CHECK(found.mechanism->id == "range-noise");
  for (const auto& set : e.undecided_between) CHECK(std::ranges::count(set, "range-noise") == 1);
  CHECK(std::ranges::any_of(e.notes, [](const std::string& note) {
    return note.find("Every beam has noise of its own") != std::string::npos;
  }));
}

}  // namespace light_and_lamps_test
