// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/explain/reduce.hpp"

namespace fit::explain {
namespace {

/// One cell in place of several: their weighted deviation at the place of the middle one.
Cell middle_of(const std::vector<const Cell*>& run) {
  Cell cell = *run[run.size() / 2];
  double weight = 0, off = 0;
  cell.n = 0;
  for (const Cell* one : run) {
    const double w = one->n / one->pooled_mm2;
    weight += w;
    off += w * (one->mean_mm - one->nominal_mm);
    cell.n += one->n;
  }
  cell.mean_mm = cell.nominal_mm + off / weight;
  cell.pooled_mm2 = cell.n / weight;
  return cell;
}

}  // namespace

Reduced merged(const Reduced& reduced, std::size_t rows) {
  const std::size_t together = std::max<std::size_t>(1, (reduced.smooth_cells() + rows - 1) / rows);
  Reduced out;
  out.bench = reduced.bench;
  out.captures = reduced.captures;
  out.absent = reduced.absent;
  out.same_as = reduced.same_as;
  out.first_temperature_c = reduced.first_temperature_c;
  out.has_intensity = reduced.has_intensity;
  out.has_temperature = reduced.has_temperature;
  out.empirical = reduced.empirical;
  std::vector<const Cell*> run;
  for (Group group : reduced.groups) {
    const std::size_t first = out.cells.size();
    const auto close = [&] {
      if (!run.empty()) out.cells.push_back(middle_of(run));
      run.clear();
    };
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!cell.smooth) continue;
      if (!run.empty() && (run.size() == together || run.back()->sight.target != cell.sight.target)) close();
      run.push_back(&cell);
    }
    close();
    group.first_cell = first;
    group.last_cell = out.cells.size();
    out.groups.push_back(group);
  }
  return out;
}

}  // namespace fit::explain
