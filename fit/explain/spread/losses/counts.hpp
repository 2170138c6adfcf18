// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/reduce.hpp"

namespace fit::explain::spread {

/// Samples of one cell, with echo or not.
struct Count {
  double intensity, beam_deg, lost, all, time_s;
  int capture;
};
struct Counts {
  std::vector<Count> cells;
  double lost = 0, all = 0;
  double darkest = 1e9;  ///< Intensity, counts.
};

/// With what they are together.
[[nodiscard]] Counts summed(std::vector<Count> cells);

/// Of all cells that cannot but meet their target.
[[nodiscard]] Counts count(const Reduced& reduced, bool near_threshold);

}  // namespace fit::explain::spread
