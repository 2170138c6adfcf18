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
};
[[nodiscard]] Fitted fit(const Session& session, const Hypothesis& hypothesis);

}  // namespace fit::explain::inference
