// SPDX-License-Identifier: MIT
// Where a formula of the catalogue and an unnamed function of the same coordinate say the same.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "noise_findings.hpp"
#include "tests/support/imagined_room.hpp"

namespace explain_functions_test {
namespace {

NoiseFindings found_with(double period_mm) {
  ImaginedRoom room;
  room.sigma_mm = 3;
  room.scans = 16;
  room.stretch = [period_mm](double, double range_mm, double) {
    return 3 * std::sin(2 * fit::pi * range_mm / period_mm + 1);
  };
  return NoiseFindings(room.record());
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

}  // namespace explain_functions_test
