// SPDX-License-Identifier: MIT
#include "fit/explain/spread/losses/counts.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fit/angle.hpp"
#include "fit/explain/spread/losses/sure_hits.hpp"

namespace fit::explain::spread {

Counts summed(std::vector<Count> cells) {
  Counts counts;
  counts.cells = std::move(cells);
  for (const Count& c : counts.cells) {
    counts.lost += c.lost;
    counts.all += c.all;
    if (std::isfinite(c.intensity)) counts.darkest = std::min(counts.darkest, c.intensity);
  }
  return counts;
}

SpreadCurve losses_along_intensity(const Counts& counts, const std::function<double(double)>& law) {
  constexpr double points = 30, points_of_lost = 8;
  std::vector<Count> cells = counts.cells;
  std::ranges::sort(cells, {}, &Count::intensity);
  SpreadCurve curve;
  curve.shows = "share of echoes that are missing";
  curve.observable = Observable::dropout;
  curve.coordinate = Coordinate::intensity;
  double lost = 0, all = 0, intensity = 0, expected = 0;
  for (const Count& c : cells) {
    lost += c.lost;
    all += c.all;
    intensity += c.all * c.intensity;
    expected += c.all * law(c.intensity);
    if (all < counts.all / points && lost < counts.lost / points_of_lost && &c != &cells.back()) continue;
    curve.add(intensity / all, {lost / all, std::sqrt(std::max(0.5, lost)) / all}, 0, expected / all);
    lost = all = intensity = expected = 0;
  }
  return curve;
}

Counts count(const Reduced& reduced, bool near_threshold) {
  std::vector<Count> cells;
  for (std::size_t i = 0; i < reduced.cells.size(); ++i) {
    const Cell& cell = reduced.cells[i];
    if (cell.n + cell.lost == 0) continue;
    if (std::abs(cell.at.incidence_rad) > 75 * rad_per_deg || may_miss_its_target(reduced, i, near_threshold))
      continue;
    const double all = cell.n + cell.stray + cell.lost;
    cells.push_back({cell.at.intensity, cell.beam_rad * deg_per_rad, static_cast<double>(cell.lost), all,
                     cell.at.time_s, reduced.groups[static_cast<std::size_t>(cell.group)].capture});
  }
  Counts counts = summed(std::move(cells));
  // Cells that lost everything are as dark as the darkest seen.
  for (Count& c : counts.cells)
    if (!std::isfinite(c.intensity)) c.intensity = counts.darkest;
  return counts;
}

}  // namespace fit::explain::spread
