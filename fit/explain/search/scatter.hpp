// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/search/fitting.hpp"

namespace fit::explain::search {

/// Factor by which means scatter more than their samples say, where that is beyond doubt; else 1.
[[nodiscard]] double excess_beyond_doubt(const Fitting& fitting, const Hypothesis& empty);

/// Variance (mm^2) of what whole groups are off beyond what their cells say; 0: they are not.
[[nodiscard]] double scatter_of_groups(Fitting& fitting, const Hypothesis& best);

}  // namespace fit::explain::search
