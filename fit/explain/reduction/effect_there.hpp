// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::reduction {

/// What all that is at work does there, with the steps of the output.
[[nodiscard]] Effect effect_there(const Reduced& reduced, const std::vector<Active>& at_work,
                                  const Circumstances& at);
/// The edges in sight of a group, from where mechanisms at work have the lidar.
[[nodiscard]] std::vector<Edge> edges_there(const Reduced& reduced, const Group& group, const Scene& scene,
                                            const std::vector<Active>& at_work);

}  // namespace fit::explain::reduction
