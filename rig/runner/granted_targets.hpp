// SPDX-License-Identifier: MIT
#pragma once

#include <set>
#include <string>
#include <vector>

#include "fit/bench/bench.hpp"
#include "rig/procedure/procedure_plan.hpp"

namespace rig {

/// The targets that a procedure measures without a prompt having placed them: they must stand where the bench
/// file says.
[[nodiscard]] std::set<std::string> taken_for_granted(const std::vector<PlannedStep>& plan,
                                                      const Variables& variables, const fit::Bench& bench);

}  // namespace rig
