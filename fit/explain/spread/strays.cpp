// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {

void strays(const Reduced& reduced, SpreadResult& result) {
  double strays = 0, beside = 0, samples = 0;
  for (const Cell& cell : reduced.cells) {
    if (!cell.smooth || reduced.groups[static_cast<std::size_t>(cell.group)].scans < 4) continue;
    // A wide beam meets what stands behind an edge from farther away than most: no stray.
    constexpr double reach_rad = 1.2 * rad_per_deg;
    if (cell.at.gap_mm != 0 && std::abs(cell.at.edge_rad) < reach_rad) continue;
    strays += cell.far;
    beside += cell.beside;
    samples += cell.n + cell.stray;
  }
  if (samples < 100) return;
  Suspect suspect = suspected(ids::outliers);
  suspect.gain = 4 * strays;  // each lies where the noise leaves less than e^-18; distances are log-uniform
  suspect.evidence = suspect.gain - 4;
  // Those that fell among the target's own samples are taken for as many as fell just beside these, which are
  // counted twice therefore.
  const double variance = strays + 3 * beside + 0.25;
  suspect.parameters = {{"fraction", {(strays + beside) / samples, std::sqrt(variance) / samples}}};
  if (suspect.evidence > accept_rare_at) result.accepted.push_back(suspect);
}

}  // namespace fit::explain::spread
