// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/reduce.hpp"
#include "fit/explain/spread.hpp"

/// Questions about single samples for which the model has no rows. Each adds what it finds to the result.
namespace fit::explain::spread {

/// Do ranges come in coarse steps? Adds `rounding`.
void output_steps(const Reduced& reduced, SpreadResult& result);

/// How gradually does the farther surface take over at edges? Adds `mixed-pixel`, and its width to the noise.
void edges(const Reduced& reduced, SpreadResult& result);

}  // namespace fit::explain::spread
