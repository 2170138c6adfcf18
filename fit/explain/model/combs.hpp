// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/model/spans.hpp"
#include "fit/mechanism.hpp"

namespace fit::explain::model {

/// The coordinate, with `zero` bins added, is rounded to a multiple of `bin`.
struct Comb {
  double bin = 0, zero = 0;
};

/// Combs to which the coordinate may be rounded, the likeliest first; all of zero 0, or of any. A comb fits
/// only within a thousandth of its bin, so that tens of thousands are possible: those whose first harmonic
/// shows in the spectrum of the scores are tried.
[[nodiscard]] std::vector<Comb> combs_in(const std::vector<RowScore>& rows, const Parameter& bins,
                                         bool any_zero);

}  // namespace fit::explain::model
