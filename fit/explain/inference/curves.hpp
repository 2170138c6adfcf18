// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/inference/posterior.hpp"
#include "fit/explain/model/spread.hpp"

namespace fit::explain::inference {

/// Pictures of the channels beside the means, along the coordinates of what was found there: as recorded, as
/// simulated when nothing was known, and as explained.
[[nodiscard]] std::vector<SpreadCurve> curves_of(const Session& session, const Fitted& nothing,
                                                 const Fitted& best, const Posterior& posterior);

}  // namespace fit::explain::inference
