// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <vector>

#include "fit/explain/inference/screen.hpp"

namespace fit::explain::inference {

/// All hypotheses that were fitted, at one linearisation, and the best of them.
struct Explored {
  std::map<std::vector<const Kind*>, Hypothesis> visited;
  Fitted best;
};

/// The best hypothesis of no more than one term.
[[nodiscard]] Hypothesis best_of_one(Session& session, const Progress& progress);

/// Adds, drops and exchanges terms until nothing improves. The session is left linearised at the best.
[[nodiscard]] Explored explore(Session& session, const Progress& progress);

}  // namespace fit::explain::inference
