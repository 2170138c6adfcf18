// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <iterator>

#include "fit/explain/numbers.hpp"
#include "fit/explain/reduction/reduce.hpp"

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
    off += w * one->off_mm();
    cell.n += one->n;
  }
  cell.mean_mm = cell.nominal_mm + off / weight;
  cell.pooled_mm2 = cell.n / weight;
  return cell;
}

/// Beside an edge or a corner the next beam meets other circumstances.
bool is_apart(const Cell& cell) { return !cell.at.alone || cell.mixed_mm > 0; }

/// The cells of one group that are taken together, row by row.
std::vector<std::vector<const Cell*>> rows_of(const Reduced& reduced, const SearchRows& search,
                                              std::size_t group) {
  std::vector<std::vector<const Cell*>> runs;
  if (!search.take(group)) return runs;
  const Group& all = reduced.groups[group];
  const std::size_t together = search.together(group);
  for (const Cell& cell : reduced.cells_of(all)) {
    if (!cell.usable) continue;
    if (runs.empty() || runs.back().size() == together ||
        runs.back().back()->sight.target != cell.sight.target || is_apart(cell) ||
        is_apart(*runs.back().back()))
      runs.emplace_back();
    runs.back().push_back(&cell);
  }
  return runs;
}

}  // namespace

SearchRows::SearchRows(const Reduced& reduced, bool only_usable, std::size_t rows_in_all,
                       std::size_t at_least)
    : at_least_(at_least),
      widest_(std::max(static_cast<double>(at_least), numbers::merged_rad / reduced.bench.lidar.step_rad)) {
  for (const Group& group : reduced.groups) {
    double count = 0;
    for (const Cell& cell : reduced.cells_of(group)) count += !only_usable || cell.usable;
    cells_.push_back(count);
  }
  // As many rows for every group, but no more than it has.
  std::vector<double> rows = cells_;
  for (double& count : rows) count = std::ceil(count / static_cast<double>(at_least_));
  std::ranges::sort(rows);
  auto left = static_cast<double>(rows_in_all);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    quota_ = left / static_cast<double>(rows.size() - i);
    if (rows[i] > quota_) return;
    left -= rows[i];
  }
  quota_ = 1e300;
}

std::size_t SearchRows::together(std::size_t group) const {
  const double needed = std::ceil(cells_[group] / quota_);
  return static_cast<std::size_t>(std::clamp(needed, static_cast<double>(at_least_), widest_));
}

bool SearchRows::take(std::size_t group) const {
  constexpr double golden = 0.6180339887498949;  // meets no period that stage or mirror may have
  double whole;
  return std::modf(static_cast<double>(group) * golden, &whole) * cells_[group] <
         quota_ * static_cast<double>(together(group));
}

std::vector<std::vector<const Cell*>> taken_together(const Reduced& reduced, std::size_t rows) {
  const SearchRows search(reduced, true, rows);
  std::vector<std::vector<const Cell*>> all;
  for (std::size_t g = 0; g < reduced.groups.size(); ++g)
    std::ranges::move(rows_of(reduced, search, g), std::back_inserter(all));
  return all;
}

Reduced merged(const Reduced& reduced, std::size_t rows) {
  const SearchRows search(reduced, true, rows);
  Reduced out;
  out.bench = reduced.bench;
  out.captures = reduced.captures;
  out.absent = reduced.absent;
  out.same_as = reduced.same_as;
  out.reference_temperature_c = reduced.reference_temperature_c;
  out.has_intensity = reduced.has_intensity;
  out.output_steps = reduced.output_steps;
  for (std::size_t g = 0; g < reduced.groups.size(); ++g) {
    Group group = reduced.groups[g];
    const std::size_t first = out.cells.size();
    for (const auto& run : rows_of(reduced, search, g)) out.cells.push_back(middle_of(run));
    group.first_cell = first;
    group.last_cell = out.cells.size();
    out.groups.push_back(group);
  }
  return out;
}

}  // namespace fit::explain
