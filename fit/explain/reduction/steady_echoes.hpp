// SPDX-License-Identifier: MIT
#pragma once

#include <span>
#include <vector>

#include "fit/explain/reduce.hpp"

namespace fit::explain::reduction {

/// Takes the echoes of neighbouring beams, which are given in order, on one line where they lie on one within
/// their noise: a beam's own mean wavers with its samples, and a range that follows the echo steeply would
/// seem to follow it less. Returns the counts that every cell had by itself.
[[nodiscard]] std::vector<double> steady_echoes(std::span<Cell> cells);

/// The same of every group.
[[nodiscard]] std::vector<double> steady_echoes(Reduced& reduced);

/// Gives every cell those counts, and takes those that it had.
void exchange_echoes(Reduced& reduced, std::vector<double>& counts);

}  // namespace fit::explain::reduction
