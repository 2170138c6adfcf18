// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/inference/gaussian.hpp"
#include "fit/explain/inference/optimum.hpp"

namespace fit::explain::inference {

/// A hypothesis at its best values with its evidence, and what a search asks about it.
struct Fitted {
  Hypothesis hypothesis;
  Design design;
  Optimum optimum;
  bool suits_sizes = true;  ///< deviations are shares of the sizes that were found, within their u
};
[[nodiscard]] Fitted fit(const Session& session, const Hypothesis& hypothesis);

}  // namespace fit::explain::inference
