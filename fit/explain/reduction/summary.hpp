// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/reduction/placing.hpp"

namespace fit::explain::reduction {

/// Robust standard deviation (mm) of one sample: the median over beams of each beam's own; what the bench
/// states where nothing tells.
[[nodiscard]] double typical_spread(const Samples& samples, const Bench& bench);

/// Fills in what remains of the samples of a placed cell, and judges by them whether its mean may be
/// compared. The session counts them; `keep_samples`: and keeps those that belong to the target.
void summarise(const Setting& setting, const Beams& beams, bool keep_samples, Cell& cell, Reduced& session);

}  // namespace fit::explain::reduction
