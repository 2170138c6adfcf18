// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/hypothesis.hpp"

namespace fit::explain::inference {

/// Decides which cells may be compared, once mount and targets are known a little better than the bench file
/// knows them, and how well: the factor on the variance of means by which neighbouring cells scatter more
/// than their samples say. The cells are left predicted there, their variances pooled.
[[nodiscard]] double fit_placements(Reduced& reduced, const MeanNoise& noise);

}  // namespace fit::explain::inference
