// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <vector>

#include "fit/explain/reduce.hpp"
#include "fit/explain/spread.hpp"

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

/// The share that is lost along the echoes' intensity, and by a law, a probability of each intensity.
[[nodiscard]] SpreadCurve losses_along_intensity(const Counts& counts,
                                                 const std::function<double(double intensity)>& law);

/// Of all cells that cannot but meet their target.
[[nodiscard]] Counts count(const Reduced& reduced, bool near_threshold);

}  // namespace fit::explain::spread
