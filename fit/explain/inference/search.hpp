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

/// Adds, drops and exchanges terms until nothing improves. The session is left linearised at the best.
[[nodiscard]] Explored explore(Session& session, const Progress& progress);

}  // namespace fit::explain::inference
