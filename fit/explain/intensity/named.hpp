// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/intensity/deviations.hpp"

namespace fit::explain::intensity {

/// The best values of a mechanism on top of the model's base, on one target or on all (-1).
[[nodiscard]] Suspicion look(const Readings& readings, const Model& model, const Mechanism& mechanism,
                             int target);

/// Coefficients of the law that are wrong: each alone, two together, and all that were stated. Without
/// coefficients when none was stated.
[[nodiscard]] Suspicion look_at_law(const Readings& readings, const Model& model);

/// The best values of a mechanism from where it is, by the gain of the likelihood.
void refine(const Readings& readings, const Model& model, Suspicion& suspicion, int evaluations);

}  // namespace fit::explain::intensity
