// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/broken_scans.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

namespace broken_scans_test {
namespace {

using fit::explain::reduction::RepeatedScans;
using fit::explain::reduction::Samples;

constexpr int beams = 200;

std::vector<std::uint16_t> noisy(std::mt19937& random, double sigma_mm) {
  std::normal_distribution<double> noise(1500, sigma_mm);
  std::vector<std::uint16_t> range(beams);
  for (auto& mm : range) mm = static_cast<std::uint16_t>(std::lround(noise(random)));
  return range;
}

fit::ScanView view_of(const std::vector<std::uint16_t>& range) {
  fit::ScanView scan;
  scan.range_mm = range;
  return scan;
}

Samples samples_of(int scans, const std::function<bool(int scan, int beam)>& echoes) {
  Samples samples;
  samples.scans = scans;
  samples.beams = beams;
  for (int scan = 0; scan < scans; ++scan)
    for (int beam = 0; beam < beams; ++beam) samples.range.push_back(echoes(scan, beam) ? 1500.0F : 0.0F);
  return samples;
}

}  // namespace

TEST_CASE("a scan that comes again is known among noisy ones, and silence is none") {
  std::mt19937 random(3);
  RepeatedScans again;
  const auto first = noisy(random, 3), second = noisy(random, 3);
  const std::vector<std::uint16_t> silent(beams, 0);
  CHECK_FALSE(again.is_again(view_of(first)));
  CHECK_FALSE(again.is_again(view_of(second)));
  CHECK(again.is_again(view_of(second)));
  CHECK_FALSE(again.is_again(view_of(silent)));
  CHECK_FALSE(again.is_again(view_of(silent)));
  CHECK_FALSE(again.is_again(view_of(first)));
  CHECK(again.is_again(view_of(first)));
  again.next_capture();
  CHECK_FALSE(again.is_again(view_of(first)));
}

TEST_CASE("scans of a lidar without noise are as good as each other") {
  std::mt19937 random(5);
  RepeatedScans again;
  const auto same = noisy(random, 3);
  for (int scan = 0; scan < 10; ++scan) CHECK_FALSE(again.is_again(view_of(same)));
}

TEST_CASE("columns of scans with their own geometry have their middles at the first one's beams") {
  for (const int count : {360, 361, 1091}) {
    const double spacing_rad = 2 * fit::pi / count, through_rad = -1.2345;
    const fit::explain::AngleGrid grid(through_rad, spacing_rad);
    REQUIRE(grid.count() == static_cast<std::size_t>(count));
    for (const int beam : {0, 7, 200, -3}) {
      const double angle_rad = fit::wrap_angle(through_rad + beam * spacing_rad);
      INFO(count << " columns, beam " << beam);
      CHECK(fit::wrap_angle(grid.middle_rad(grid.column_of(angle_rad)) - angle_rad) ==
            Approx(0).margin(1e-9));
      CHECK(grid.column_of(angle_rad + 0.4 * spacing_rad) == grid.column_of(angle_rad));
    }
  }
}

TEST_CASE("a capture whose later scans all end at one beam was cut there") {
  Samples cut = samples_of(20, [](int scan, int beam) { return scan < 10 || beam < 120; });
  CHECK(fit::explain::reduction::do_not_look_at_gaps(cut) == 10);
  CHECK(cut.at(10, 120) < 0);
  CHECK(cut.at(9, 120) > 0);
  CHECK(cut.at(10, 119) > 0);
  // Someone who stands there has edges that noise moves by a beam.
  Samples hidden = samples_of(20, [](int scan, int beam) { return scan < 10 || beam < 120 + scan % 2; });
  CHECK(fit::explain::reduction::do_not_look_at_gaps(hidden) == 0);
}

TEST_CASE("a scan that breaks off now and then is as not looked at, and what often loses an end is not") {
  const auto lost_at_end = [](int scan, int every) {
    return samples_of(30, [=](int s, int beam) { return beam < 120 || s % every != scan; });
  };
  Samples rare = lost_at_end(2, 15), often = lost_at_end(1, 2);
  CHECK(fit::explain::reduction::do_not_look_at_gaps(rare) == 2);
  CHECK(rare.at(2, 150) == fit::explain::reduction::not_looked);
  CHECK(rare.at(3, 150) == 1500);
  CHECK(rare.at(2, 119) == 1500);
  CHECK(fit::explain::reduction::do_not_look_at_gaps(often) == 0);
  CHECK(often.at(1, 150) == 0);
  // A packet that is missing lies anywhere.
  Samples packet = samples_of(30, [](int s, int beam) { return s != 4 || beam < 80 || beam >= 112; });
  CHECK(fit::explain::reduction::do_not_look_at_gaps(packet) == 1);
  CHECK(packet.at(4, 79) == 1500);
  CHECK(packet.at(4, 80) == fit::explain::reduction::not_looked);
  CHECK(packet.at(4, 111) == fit::explain::reduction::not_looked);
  CHECK(packet.at(4, 112) == 1500);
  // Blind scans, and beams that never see anything, are none.
  Samples blind = samples_of(30, [](int s, int) { return s != 7; }),
          open = samples_of(30, [](int, int beam) { return beam < 120; });
  CHECK(fit::explain::reduction::do_not_look_at_gaps(blind) == 0);
  CHECK(fit::explain::reduction::do_not_look_at_gaps(open) == 0);
}

}  // namespace broken_scans_test
