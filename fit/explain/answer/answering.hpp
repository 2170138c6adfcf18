// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "fit/explain/answer/findings.hpp"
#include "fit/explain/explanation.hpp"

namespace fit::explain {

/// Turns reduced data into findings and what is told of them.
using Answer = std::function<std::pair<Findings, Explanation>(Reduced)>;

/// The way from recordings to an answer, by whatever engine: reduction before it; intensity, the twin and the
/// predictor after it. Errors as `explain`.
[[nodiscard]] Explanation explain_with(const std::vector<const Recording*>& recordings, const Progress& progress,
                                       const Answer& answer);

}  // namespace fit::explain
