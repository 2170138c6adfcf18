// SPDX-License-Identifier: MIT
#pragma once

#include <span>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::reduction {

/// Takes the echoes of neighbouring beams, which are given in order, on one line where they lie on one within
/// their noise: a beam's own mean wavers with its samples, and a range that follows the echo steeply would
/// seem to follow it less.
void steady_echoes(std::span<Cell> cells);

/// The same of every group.
void steady_echoes(Reduced& reduced);

}  // namespace fit::explain::reduction
