// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "rig/procedure/procedure_plan.hpp"

namespace rig::investigate {

/// What a session takes of a day, minutes. The operator's are estimates (below), the others the plan's.
struct Cost {
  double stage_and_scans = 0, hand = 0;
  [[nodiscard]] double total() const { return stage_and_scans + hand; }
};

/// Estimates of what a hand takes: to walk to a target, move it, square it and measure where it stands; to
/// cover it with another surface; to bring a housing to a temperature and hold it; to let a lidar cool down
/// switched off.
inline constexpr double move_min = 3, cover_min = 1, temperature_min = 15, cooling_min = 120,
                        other_prompt_min = 1;

/// Of a procedure that was unrolled.
[[nodiscard]] Cost cost_of(const std::vector<PlannedStep>& plan, const Variables& variables);

/// Whether somebody has to be there.
[[nodiscard]] bool needs_operator(const std::vector<PlannedStep>& plan);

}  // namespace rig::investigate
