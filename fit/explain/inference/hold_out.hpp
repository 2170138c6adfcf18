// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/inference/fit.hpp"
#include "fit/explain/model/mean_result.hpp"

namespace fit::explain::inference {

/// Whole captures predicted from all others; sectors of beams where captures are few. The log density is that
/// of each block as a whole given the others, in all channels or in the means only; the other figures are of
/// means.
[[nodiscard]] HeldOutFigures hold_out(const Session& session, const Fitted& fitted, bool only_means = false);

/// Whether unnamed functions of the means predict captures that had no part in them better than the rest of
/// the hypothesis alone does. True where nothing can say so: one capture, or no such function.
[[nodiscard]] bool forms_carry_over(const Session& session, const Fitted& fitted);

}  // namespace fit::explain::inference
