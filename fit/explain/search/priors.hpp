// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/search/fitting.hpp"

namespace fit::explain::search {

/// Whether `best` is better than `less` mainly because it leaves mount and targets nearer to where the bench
/// file states them.
[[nodiscard]] bool relieves_priors(const Hypothesis& best, const Hypothesis& less, const Bench& bench);

}  // namespace fit::explain::search
