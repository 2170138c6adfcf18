// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/inference/optimum.hpp"
#include "fit/explain/model/gaussian.hpp"

namespace fit::explain::inference {

/// A hypothesis at its best values with its evidence, and what a search asks about it.
struct Fitted {
  Hypothesis hypothesis;
  Design design;
  Optimum optimum;
  /// Priors and deviations are those of the sizes that were found: else its evidence is of another model.
  bool suits_sizes = true;
};
[[nodiscard]] Fitted fit(const Session& session, const Hypothesis& hypothesis);

}  // namespace fit::explain::inference
