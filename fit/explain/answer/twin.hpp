// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/bench/empirical.hpp"
#include "fit/explain/explanation.hpp"

namespace fit::explain {

/// Puts into the explanation's bench what its simulator needs beside named mechanisms to be like the device:
/// how real causes bend away from their formulas, effects whose name is undecided, and
/// where the bench claims nothing about intensity, how strong echoes are. All of it without a name, under
/// `empirical` and `sim` (docs/develop/simulator.md). `reduced` is left predicted at the best hypothesis.
/// Returns tables of the functions without a name.
std::vector<EmpiricalFunction> complete_twin(Reduced& reduced, const MeanResult& means,
                                             Explanation& explanation);

/// Ends of targets where the recording sees them; and if beams that are too wide for an edge were found, how
/// the farther surface takes over, beam by beam.
void describe_edges(const Reduced& reduced, const MeanResult& means, bool mixed, Bench& bench);

/// How strong the recording's echoes are, for the simulator.
void describe_echoes(const Reduced& reduced, Bench& bench);

}  // namespace fit::explain
