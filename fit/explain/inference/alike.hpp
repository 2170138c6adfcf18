// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/inference/posterior.hpp"

/// What a name is taken for another by.
namespace fit::explain::inference {

/// The log-likelihood that another name for what gains so much may lose: no formula is right to better than
/// such a share of its cause.
[[nodiscard]] double equivalence_margin(double share, double gain);

/// Smooth functions that may be what a mechanism is taken for. Where one stands beside it its formula does
/// not fit, and functions of that coordinate that do without it as well as the recording tells may; so may
/// any of the mechanism's own where it is called a wave that may not repeat, or lacks its own sign.
[[nodiscard]] std::vector<Named> functions_instead(const Session& session, const Fitted& best,
                                                   const Named& named);

}  // namespace fit::explain::inference
