// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/model/spans.hpp"
#include "fit/mechanism.hpp"

namespace fit::explain::model {

/// Bins to whose multiples the coordinate may be rounded, the likeliest first. A comb fits only within a
/// thousandth of its bin, so that tens of thousands are possible: those whose first harmonic shows in the
/// spectrum of the scores are tried.
[[nodiscard]] std::vector<double> bins_in(const std::vector<RowScore>& rows, const Parameter& bins);

}  // namespace fit::explain::model
