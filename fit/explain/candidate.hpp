// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/unnamed.hpp"

namespace fit::explain {

/// One more mechanism, or one more unnamed form, and how much better a model explains the means with it.
struct Candidate {
  Term term;
  std::optional<Shape> shape;  ///< If it is an unnamed form.
  double evidence = -1e300;    ///< Log of the Bayes factor, prices of what was searched included.
  double gain = 0;             ///< Of the log-likelihood.
};

/// The best values of one mechanism on top of the model's base: every start, then NLopt from the best ones.
/// `spacing_deg`: of the stage's stops.
[[nodiscard]] Candidate look(const MeanModel& model, const Term& term, std::optional<double> spacing_deg);

/// The best size of one unnamed form.
[[nodiscard]] Candidate look(const MeanModel& model, Shape shape);

}  // namespace fit::explain
