// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/steady_echoes.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "fit/numeric/straight_line.hpp"

namespace fit::explain::reduction {
namespace {

constexpr double rounding = 1.0 / 12;  // counts^2: they come as whole numbers

bool has_echo(const Cell& cell) {
  return cell.usable && cell.n > 1 && cell.intensity_sd > 0 && std::isfinite(cell.at.intensity);
}

/// A line along the beams through the echoes of some cells, at one of them; none if they do not lie on one.
std::optional<double> line_at(const Cell& middle, std::span<const Cell> cells) {
  constexpr double fewest = 5;
  constexpr double beyond_chance = 3;
  StraightLine line;
  double noise = 0, samples = 0;
  for (const Cell& cell : cells) {
    if (!has_echo(cell) || cell.at.target != middle.at.target || cell.group != middle.group) continue;
    samples += cell.n;
    noise += cell.intensity_sd * cell.intensity_sd + rounding;
    line.add(cell.beam_rad, cell.at.intensity);
  }
  if (line.points() < fewest) return {};
  const double of_mean = noise / samples, freedom = line.points() - 2;
  if (line.off() / of_mean > freedom + beyond_chance * std::sqrt(2 * freedom)) return {};
  return line.at(middle.beam_rad);
}

}  // namespace

void steady_echoes(std::span<Cell> cells) {
  std::vector<double> steady;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    steady.push_back(cells[i].at.intensity);
    if (!has_echo(cells[i])) continue;
    for (const std::size_t reach : {std::size_t{4}, std::size_t{2}}) {
      const std::size_t first = i - std::min(i, reach), last = std::min(cells.size(), i + reach + 1);
      const std::optional<double> counts = line_at(cells[i], cells.subspan(first, last - first));
      if (!counts) continue;
      steady.back() = std::max(1.0, *counts);
      break;
    }
  }
  for (std::size_t i = 0; i < cells.size(); ++i) cells[i].at.intensity = steady[i];
}

void steady_echoes(Reduced& reduced) {
  for (const Group& group : reduced.groups) steady_echoes(reduced.cells_of(group));
}

}  // namespace fit::explain::reduction
