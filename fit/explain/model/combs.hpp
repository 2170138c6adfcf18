// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/mechanism.hpp"

namespace fit::explain::model {

/// How the log-likelihood changes with each row's predictor, along a coordinate.
struct Scores {
  std::vector<double> place, score;
};

/// Bins to whose multiples the coordinate may be rounded, the likeliest first. A comb fits only within a
/// thousandth of its bin, so that tens of thousands are possible: those whose first harmonic shows in the
/// spectrum of the scores are tried.
[[nodiscard]] std::vector<double> bins_in(const Scores& scores, const Parameter& bins);

}  // namespace fit::explain::model
