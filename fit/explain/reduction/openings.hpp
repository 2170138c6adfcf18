// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <vector>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::reduction {

/// A stretch of a target through which beams went: a door, a pane of glass; or something dark.
struct Opening {
  int target = 0;
  double from_mm = 0, to_mm = 0;  ///< Along the target, from its middle.
  int captures = 0;               ///< In which it was seen.
};

/// Takes the cells out that look at a stretch of a target from which nothing comes back, or what stands far
/// behind, while the target answers on both sides of it: a stretch that stays in its place while the stage
/// turns, so that other beams look at it. It is no loss of weak echoes, and no light that falls on some
/// beams.
std::vector<Opening> leave_out_openings(Reduced& reduced);

/// Takes out targets that some captures meet where, in so many others, beams find nothing at all of them, or
/// what stands far behind: a board that was carried away.
std::map<int, int> leave_out_absent_targets(Reduced& reduced);

/// Takes out targets that hardly a beam meets where the bench file has them, though many should: `unmet` from
/// then on.
void leave_out_unmet_targets(Reduced& reduced);

}  // namespace fit::explain::reduction
