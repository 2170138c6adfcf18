// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <vector>

#include "fit/explain/inference/fit.hpp"

namespace fit::explain::inference {

/// Two mechanisms together, by a score test: what they would add to a fitted hypothesis.
struct Pair {
  std::array<Term, 2> terms;
  double log_evidence = -1e300;  ///< Against the hypothesis without them; of their sizes, a bound.
  [[nodiscard]] double log_posterior() const {
    return log_evidence + terms[0].kind->log_prior + terms[1].kind->log_prior;
  }
};

/// Of all mechanisms that nothing but sizes describe, every two that are not in the hypothesis; the most
/// probable first. An offset and a scale may show together where neither does by itself. `around`: the fitted
/// likelihood, expanded for new terms.
[[nodiscard]] std::vector<Pair> pairs_beside(const Session& session, const Fitted& fitted,
                                             const Optimum& around);

}  // namespace fit::explain::inference
