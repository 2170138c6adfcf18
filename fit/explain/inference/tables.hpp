// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/bench/empirical.hpp"
#include "fit/explain/inference/posterior.hpp"

namespace fit::explain::inference {

/// For the twin, where tables of a bench file can tell what happens in a channel: what terms without a name
/// do there, and how named ones bend away from their formulas.
[[nodiscard]] std::vector<EmpiricalFunction> tables_of(const Session& session, const Fitted& best,
                                                       const Posterior& posterior);

}  // namespace fit::explain::inference
