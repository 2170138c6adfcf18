// SPDX-License-Identifier: MIT
#pragma once

#include <utility>
#include <vector>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::reduction {

/// Sectors of beams, first and last angle (rad).
using Sectors = std::vector<std::pair<double, double>>;

/// Takes the beams out that return nothing in any capture, though beams on both sides of them see the very
/// surface on which they fall: a dead pixel or something before the window, and no loss of weak echoes.
/// Returns where they are.
Sectors leave_out_dead_beams(Reduced& reduced);

/// Takes single beams out that read otherwise than those beside them on the same surface, from three stops of
/// the stage or more, and a fifth of all: by far more than beams differ elsewhere. Returns where they are.
Sectors leave_out_odd_beams(Reduced& reduced);

}  // namespace fit::explain::reduction
