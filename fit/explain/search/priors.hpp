// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/search/fitting.hpp"

namespace fit::explain::search {

/// Whether `best` is better than `less` mainly because it leaves mount and targets nearer to where the bench
/// file states them.
[[nodiscard]] bool relieves_priors(const Hypothesis& best, const Hypothesis& less, const Bench& bench);

/// Where a hypothesis has mount and targets far from where the bench file states them, it is believed so much
/// less: the file may be wrong there, and nothing else is to be named only because it relieves that.
void believe_bench_less(Hypothesis& h, const Bench& bench);

/// A term that only the bench file's uncertainties show, and others that would relieve them as well. `less`:
/// without it.
[[nodiscard]] std::vector<Term> only_priors(Fitting& fitting, const Term& term, const Hypothesis& less);

}  // namespace fit::explain::search
