// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "fit/explain/reduction/left_out.hpp"
#include "fit/explain/reduction/margins.hpp"
#include "fit/numeric/median.hpp"

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

/// Beams side by side together.
Sectors sectors_of(const std::map<long, double>& beams, const Reduced& reduced) {
  Sectors sectors;
  double step = 0;  // of the lidar's beams: the least between two
  for (std::size_t i = 1; i < reduced.cells.size(); ++i)
    if (const double s = reduced.cells[i].beam_rad - reduced.cells[i - 1].beam_rad; s > 0)
      step = step > 0 ? std::min(step, s) : s;
  for (const auto& [beam, rad] : beams)
    if (!sectors.empty() && rad - sectors.back().second < 1.5 * step)
      sectors.back().second = rad;
    else
      sectors.emplace_back(rad, rad);
  return sectors;
}

}  // namespace

Sectors leave_out_dead_beams(Reduced& reduced) {
  const std::set<long> silent = silent_beams(reduced.cells);
  std::map<long, double> dead;
  if (!silent.empty())
    for (const Group& group : reduced.groups) add_witnessed(reduced.cells_of(group), silent, dead);
  for (Cell& cell : reduced.cells)
    if (dead.contains(beam_of(cell))) cell.leave_out();
  return sectors_of(dead, reduced);
}

namespace {

/// By how far at least a beam reads longer, or shorter, than both beside it on the same surface, mm; none
/// near an edge.
std::optional<double> apart_mm(std::span<const Cell> cells, std::size_t i) {
  const Cell& cell = cells[i];
  if (cell.n == 0 || std::abs(cell.at.edge_rad) < edge_window_rad) return {};
  const double own = cell.mean_mm - cell.nominal_mm;
  const auto beyond = [&](std::size_t k) -> std::optional<double> {
    if (!cells[k].usable || cells[k].at.target != cell.at.target) return {};
    return own - (cells[k].mean_mm - cells[k].nominal_mm);
  };
  if (cells.size() < 3) return {};
  const std::size_t last = cells.size() - 1;
  const auto one = beyond(i == 0 ? 1 : i - 1), other = beyond(i == 0 ? 2 : i == last ? i - 2 : i + 1);
  if (!one || !other) return {};
  return *one * *other > 0 ? std::min(std::abs(*one), std::abs(*other)) : 0;
}

}  // namespace

Sectors leave_out_odd_beams(Reduced& reduced) {
  constexpr double least_mm = 10, far = 10, often = 0.2;
  constexpr std::size_t fewest_stops = 3;  // from which it cannot look at the same place
  struct Beam {
    double rad = 0;
    std::vector<std::pair<double, double>> apart;  // stage angle, and mm
  };
  std::map<long, Beam> beams;
  std::vector<double> all;
  for (const Group& group : reduced.groups) {
    const auto cells = reduced.cells_of(group);
    for (std::size_t i = 0; i < cells.size(); ++i)
      if (const auto mm = apart_mm(cells, i)) {
        Beam& beam = beams[beam_of(cells[i])];
        beam.rad = cells[i].beam_rad;
        beam.apart.emplace_back(group.stage_rad, *mm);
        if (*mm > 0) all.push_back(*mm);
      }
  }
  const double usual_mm = std::max(least_mm, far * median_of(std::move(all)));
  std::map<long, double> odd;
  for (const auto& [number, beam] : beams) {
    std::set<double> stops, odd_at;
    for (const auto& [stage_rad, mm] : beam.apart) {
      stops.insert(stage_rad);
      if (mm > usual_mm) odd_at.insert(stage_rad);
    }
    if (odd_at.size() >= fewest_stops &&
        static_cast<double>(odd_at.size()) >= often * static_cast<double>(stops.size()))
      odd[number] = beam.rad;
  }
  for (Cell& cell : reduced.cells)
    if (odd.contains(beam_of(cell))) {
      cell.leave_out();
      cell.n = 0;
    }
  return sectors_of(odd, reduced);
}

}  // namespace fit::explain::reduction
