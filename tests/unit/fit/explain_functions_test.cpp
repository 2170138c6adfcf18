// SPDX-License-Identifier: MIT
// Where a formula of the catalogue and an unnamed function of the same coordinate say the same.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "fit/explain/explanation.hpp"
#include "noise_findings.hpp"
#include "plain_scenes.hpp"
#include "tests/support/imagined_room.hpp"

namespace explain_functions_test {
namespace {

/// `stretch_mm`: by how much ranges are too long.
template <class Stretch>
NoiseFindings found_where(const Stretch& stretch_mm) {
  ImaginedRoom room;
  room.sigma_mm = 3;
  room.scans = 16;
  room.stretch = [&](double, double range_mm, double) { return stretch_mm(range_mm); };
  return NoiseFindings(room.record());
}

NoiseFindings found_with(double period_mm) {
  return found_where([&](double range_mm) { return 3 * std::sin(2 * fit::pi * range_mm / period_mm + 1); });
}

}  // namespace

TEST_CASE(
    "a wave along the range is named where it repeats, and may be any function where nobody sees it repeat") {
  const NoiseFindings repeats = found_with(700);
  INFO(repeats.in_words());
  REQUIRE(repeats.accepted.size() == 1);
  CHECK(repeats.accepted.front().mechanism->id == "cyclic-error");
  CHECK(repeats.undecided.empty());

  const NoiseFindings once = found_with(2800);
  INFO(once.in_words());
  CHECK(once.accepted.empty());
  // As names of a set, or as unknown physics alone.
  const bool may_be_unknown =
      !once.unknown.empty() || std::ranges::any_of(once.undecided, [](const auto& set) {
        return std::ranges::count(set, "unknown-physics") > 0;
      });
  CHECK(may_be_unknown);
}

TEST_CASE("a zero of the range that wanders from capture to capture is told as that") {
  const plain_bench::PlainScene scene{.walls = plain_bench::l_shaped};
  std::mt19937 random(41);
  std::vector<double> zeros_mm;
  for (int capture = 0; capture < 24; ++capture)
    zeros_mm.push_back(1.2 * std::normal_distribution<double>()(random));
  SyntheticRecording recording = plain_bench::recorded(scene, 41, [&](double, double, double time_s) {
    const double captures = (time_s - 1800) / 20;  // one begins every 20 s
    return plain_bench::Deviation{.range_mm = zeros_mm.at(static_cast<std::size_t>(captures))};
  });
  plain_bench::turn_round(recording, scene, 24);
  const auto e = fit::explain::explain({&recording}, {});
  INFO(to_text(e));
  CHECK(e.mechanisms.empty());
  REQUIRE(e.unknown);
  const std::string begins = "the range's zero wanders from capture to capture, by ";
  REQUIRE_THAT(e.unknown->describes, Catch::StartsWith(begins));
  double sum = 0, squares = 0;
  for (const double mm : zeros_mm) sum += mm, squares += mm * mm;
  CHECK(std::stod(e.unknown->describes.substr(begins.size())) ==
        Approx(std::sqrt((squares - sum * sum / 24) / 23)).epsilon(0.1));
}

TEST_CASE("a range scale that bends has no name of the catalogue") {
  const NoiseFindings bends =
      found_where([](double range_mm) { return 0.8 * std::pow(range_mm / 1000 - 2.5, 2); });
  INFO(bends.in_words());
  const bool may_be_unknown =
      !bends.unknown.empty() || std::ranges::any_of(bends.undecided, [](const auto& set) {
        return std::ranges::count(set, "unknown-physics") > 0;
      });
  CHECK(may_be_unknown);
  for (const auto& found : bends.accepted) {  // what an offset or a scale may be beside it
    INFO(found.mechanism->id);
    CHECK((found.mechanism->id == "zero-offset" || found.mechanism->id == "range-scale"));
  }
}

}  // namespace explain_functions_test
