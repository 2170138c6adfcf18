// SPDX-License-Identifier: MIT
#include "rig/runner/echoes.hpp"

#include <limits>

#include "fit/numeric/median.hpp"

namespace rig {
namespace {

constexpr int scans_of_a_check = 10;

}  // namespace

void Echoes::add(const lidar::Scan& scan, std::size_t offset) {
  ++scans_;
  for (std::size_t i = 0; i < ranges_.size() && offset + i < scan.range_mm.size(); ++i) {
    if (scan.range_mm[offset + i] == 0) continue;
    ranges_[i].push_back(scan.range_mm[offset + i]);
    if (offset + i < scan.intensity.size()) levels_[i].push_back(scan.intensity[offset + i]);
  }
}

bool Echoes::enough() const { return scans_ >= scans_of_a_check; }

BeamMedians Echoes::seen() const {
  constexpr double none = std::numeric_limits<double>::quiet_NaN();
  BeamMedians seen;
  for (std::size_t i = 0; i < ranges_.size(); ++i) {
    const bool sure = ranges_[i].size() >= scans_of_a_check / 2;
    seen.range_mm.push_back(sure ? fit::median_of(std::vector(ranges_[i])) : none);
    seen.intensity.push_back(sure && !levels_[i].empty() ? fit::median_of(std::vector(levels_[i])) : none);
  }
  return seen;
}

}  // namespace rig
