// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/explain/reduction/selected_captures.hpp"

namespace fit::explain {

/// Recordings, in their order, without the captures in which the lidar merged neighbouring steps (SCIP's
/// cluster count). Of a cluster it sends the nearest range: the smallest of several noisy readings, across a
/// slanted wall the near end's. That is shorter than any single beam's, by no physics that could be missing,
/// and scatters less. Throws std::invalid_argument if captures were recorded and none is left.
[[nodiscard]] std::vector<SelectedCaptures> single_beams(const std::vector<const Recording*>& recordings);

/// A sentence for the operator; empty if nothing was left out.
[[nodiscard]] std::string note_on_clusters(const std::vector<SelectedCaptures>& recordings);

}  // namespace fit::explain
