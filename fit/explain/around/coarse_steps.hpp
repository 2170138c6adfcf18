// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/model/spread.hpp"
#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain {

/// Do ranges come in coarse steps? Then adds `rounding` to the result, and to the session what such steps do
/// to means and variances. `sigma_mm`: the noise of one sample.
void find_coarse_steps(Reduced& reduced, double sigma_mm, SpreadResult& result);

}  // namespace fit::explain
