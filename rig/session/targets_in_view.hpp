// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "fit/bench/bench.hpp"

namespace rig {

/// Both ends of a target in the lidar's frame (mm, whole ones), as scans are, while the stage stands at
/// `stage_deg`: [[x, y], [x, y]].
[[nodiscard]] nlohmann::json target_in_view(const fit::Target& target, const fit::Bench& bench,
                                            double stage_deg);

/// All targets where the bench file has them.
[[nodiscard]] nlohmann::json targets_in_view(const fit::Bench& bench, double stage_deg);

}  // namespace rig
