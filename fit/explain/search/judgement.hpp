// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/mean_search.hpp"
#include "fit/explain/search/fitting.hpp"

namespace fit::explain::search {

/// Drops what does not help where it was not fitted to, and sets beside every mechanism what else could do
/// the same. `best` may change, and is the result's.
void judge(Fitting& fitting, Hypothesis& best, MeanResult& result);

}  // namespace fit::explain::search
