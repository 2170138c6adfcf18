// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::reduction {

/// Beside an edge: the mean place of samples between the two surfaces, and how many lie on neither. Nothing
/// where the surfaces are too close for the noise and for what the bench file leaves open.
template <class Ranges>
void share_out(const Ranges& ranges_mm, double near_mm, double far_mm, double sigma_mm, Cell& cell) {
  cell.far_share = -1;
  cell.between = 0;
  const double gap = far_mm - near_mm, off_mm = 6 * sigma_mm + std::max(15.0, 3 * cell.misplaced_mm);
  if (gap < 2 * off_mm) return;
  const double margin = off_mm / gap;
  double sum = 0;
  for (const double range : ranges_mm) {
    const double place = (range - near_mm) / gap;
    sum += std::clamp(place, 0.0, 1.0);
    if (place > margin && place < 1 - margin) ++cell.between;
  }
  cell.far_share = sum / static_cast<double>(ranges_mm.size());
}

/// The same of all cells beside edges, and how far from the edge they are, once mount and targets are fitted:
/// by the bench file both surfaces may be far from where they are.
void share_out_again(Reduced& reduced, const Nuisance& fitted, const std::vector<Active>& at_work);

}  // namespace fit::explain::reduction
