// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/spread.hpp"

namespace fit::explain {

/// If ranges come in coarse steps, adds to the empirical mechanisms what these do to means.
void add_bias_of_coarse_steps(const SpreadResult& spread, Reduced& reduced);

}  // namespace fit::explain
