// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/explain/inference/numbers.hpp"
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

SearchRows::SearchRows(const Reduced& reduced, std::size_t cells, std::size_t rows, std::size_t at_least) {
  const auto widest = static_cast<std::size_t>(numbers::merged_rad / reduced.bench.lidar.step_rad);
  const std::size_t needed = (cells + rows - 1) / rows;
  together = std::max({std::size_t{1}, at_least, std::min(needed, widest)});
  share_ = static_cast<double>(together) / static_cast<double>(std::max<std::size_t>(1, needed));
}

bool SearchRows::take(std::size_t group) const {
  constexpr double golden = 0.6180339887498949;  // meets no period that stage or mirror may have
  double whole;
  return std::modf(static_cast<double>(group) * golden, &whole) < share_;
}

Reduced merged(const Reduced& reduced, std::size_t rows) {
  const SearchRows of(reduced, reduced.smooth_cells(), rows);
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
  for (std::size_t g = 0; g < reduced.groups.size(); ++g) {
    Group group = reduced.groups[g];
    const std::size_t first = out.cells.size();
    const auto close = [&] {
      if (!run.empty()) out.cells.push_back(middle_of(run));
      run.clear();
    };
    for (std::size_t i = group.first_cell; i < group.last_cell; ++i) {
      const Cell& cell = reduced.cells[i];
      if (!cell.smooth || !of.take(g)) continue;
      if (!run.empty() && (run.size() == of.together || run.back()->sight.target != cell.sight.target))
        close();
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
