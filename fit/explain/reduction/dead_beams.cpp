// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/dead_beams.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <span>

namespace fit::explain::reduction {
namespace {

/// The same beam in all groups: they have the lidar's own steps.
long beam_of(const Cell& cell) { return std::lround(cell.beam_rad * 1e5); }

bool is_silent(const Cell& cell) { return cell.lost > 0 && cell.n + cell.stray == 0; }
bool answers(const Cell& cell) { return cell.n > cell.lost; }

/// Beams that are silent in all cells that they have.
std::set<long> silent_beams(const std::vector<Cell>& cells) {
  std::set<long> silent, others;
  for (const Cell& cell : cells) (is_silent(cell) ? silent : others).insert(beam_of(cell));
  std::erase_if(silent, [&](long beam) { return others.contains(beam); });
  return silent;
}

/// Of one group's cells, in the order of their beams: those silent ones whose next others on both sides
/// answer from the same surface.
void add_witnessed(std::span<const Cell> cells, const std::set<long>& silent,
                   std::map<long, double>& witnessed) {
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (!silent.contains(beam_of(cells[i]))) continue;
    std::size_t end = i;
    while (end < cells.size() && silent.contains(beam_of(cells[end])) &&
           cells[end].at.target == cells[i].at.target)
      ++end;
    const auto sees_it = [&](const Cell& cell) {
      return cell.at.target == cells[i].at.target && answers(cell);
    };
    if (i > 0 && end < cells.size() && sees_it(cells[i - 1]) && sees_it(cells[end]))
      for (std::size_t k = i; k < end; ++k) witnessed[beam_of(cells[k])] = cells[k].beam_rad;
    i = end - 1;
  }
}

}  // namespace

Sectors leave_out_dead_beams(Reduced& reduced) {
  const std::set<long> silent = silent_beams(reduced.cells);
  std::map<long, double> dead;
  if (!silent.empty())
    for (const Group& group : reduced.groups)
      add_witnessed(std::span(reduced.cells).subspan(group.first_cell, group.last_cell - group.first_cell),
                    silent, dead);
  for (Cell& cell : reduced.cells)
    if (dead.contains(beam_of(cell))) cell.lost = 0, cell.smooth = false;
  Sectors sectors;
  double step = 0;  // of the lidar's beams: the least between two
  for (std::size_t i = 1; i < reduced.cells.size(); ++i)
    if (const double s = reduced.cells[i].beam_rad - reduced.cells[i - 1].beam_rad; s > 0)
      step = step > 0 ? std::min(step, s) : s;
  for (const auto& [beam, rad] : dead)
    if (!sectors.empty() && rad - sectors.back().second < 1.5 * step)
      sectors.back().second = rad;
    else
      sectors.emplace_back(rad, rad);
  return sectors;
}

}  // namespace fit::explain::reduction
