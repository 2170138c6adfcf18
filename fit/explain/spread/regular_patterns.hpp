// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/spread.hpp"

namespace fit::explain::spread {

/// Takes off a cell what differs from scan to scan: its mean over the scans, and its variance, most of the
/// cell's own at the most.
void take_off(double mean_mm, double variance_mm2, Cell& cell);

/// Takes what mirror faces and a stage that swings after moves leave in the cells off their means and
/// variances: every scan of a capture meets another face, or another phase of the swing. Once.
void take_off_patterns(const SpreadResult& found, Reduced& reduced);

/// Takes noise away again that such patterns leave which are not quite as their formulas have them, or strays
/// that fell among the samples of their targets.
void distrust_beside_patterns(SpreadResult& result);

}  // namespace fit::explain::spread
