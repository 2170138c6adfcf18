// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/explanation.hpp"

namespace fit::explain {

/// What `explain` does, by the statistical model of docs/method/model.md; experimental. Errors as there.
[[nodiscard]] Explanation explain_by_one_model(const std::vector<const Recording*>& recordings,
                                               const Progress& progress);

}  // namespace fit::explain
