// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/search/fitting.hpp"

namespace fit::explain::search {

/// Fits, and says anew which cells meet what, until that has settled: beams by a corner of walls that stand
/// otherwise than stated would be laid to the wrong one.
void settle(Fitting& fitting, Hypothesis& h);

}  // namespace fit::explain::search
