// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/range_limit.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace fit::explain::reduction {
namespace {

/// Whether noise may take the cell's samples there.
bool may_reach(const RangeLimit& limit, const Cell& cell, double sigma_mm) {
  constexpr double widths = 4;
  return cell.nominal_mm > limit.mm - widths * sigma_mm;
}

}  // namespace

std::optional<RangeLimit> range_limit(const Reduced& reduced) {
  constexpr int fewest_samples = 5;  // that agree to the millimetre
  constexpr double fewest_cells = 0.01, far_fewer = 0.1;
  constexpr double noisy_mm = 1;
  const double sigma_mm = reduced.typical_sigma_mm();
  if (sigma_mm < noisy_mm) return {};  // all beams repeat themselves
  struct Beams {
    double cells = 0, beyond = 0, samples = 0;
  };
  std::map<long, Beams> at;
  double cells = 0, samples = 0;
  for (const Cell& cell : reduced.cells) {
    if (cell.n == 0) continue;
    cells += 1;
    samples += cell.n;
    if (cell.n < fewest_samples || cell.variance_mm2 != 0) continue;
    Beams& beams = at[std::lround(cell.mean_mm)];
    beams.cells += 1;
    beams.samples += cell.n;
    beams.beyond += may_reach({.mm = cell.mean_mm}, cell, sigma_mm) ? 1 : 0;
  }
  if (at.empty()) return {};
  const auto& [mm, beams] =
      *std::ranges::max_element(at, {}, [](const auto& one) { return one.second.cells; });
  const auto farther = static_cast<double>(std::ranges::count_if(reduced.cells, [&](const Cell& cell) {
    return cell.n > 0 && cell.mean_mm > static_cast<double>(mm) + 0.5;
  }));
  if (beams.cells < std::max(10.0, fewest_cells * cells) || farther > far_fewer * beams.cells ||
      beams.cells - beams.beyond > far_fewer * beams.cells)
    return {};
  return RangeLimit{static_cast<double>(mm), beams.samples / samples};
}

std::vector<Occluder> beyond(const Reduced& reduced, const RangeLimit& limit) {
  std::vector<Occluder> list;
  for (const Group& group : reduced.groups) {
    if (is_turning(reduced.capture_of(group))) continue;
    const auto is_beyond = [&](const Cell& cell) { return may_reach(limit, cell, group.sigma_mm); };
    const auto cells = reduced.cells_of(group);
    for (auto first = cells.begin(); first != cells.end();) {
      first = std::find_if(first, cells.end(), is_beyond);
      const auto end = std::find_if_not(first, cells.end(), is_beyond);
      if (first != end) list.push_back({group.capture, first->beam_rad, std::prev(end)->beam_rad});
      first = end;
    }
  }
  return list;
}

}  // namespace fit::explain::reduction
