// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/search/fitting.hpp"

namespace fit::explain::search {

/// On a regular ladder a wave looks the same as others whose turns differ by whole numbers from rung to rung:
/// the longest that fits as well is told, and the uncertainty of its period holds them all.
void doubt_aliases(Fitting& fitting, Hypothesis& best);

}  // namespace fit::explain::search
