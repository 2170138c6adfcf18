// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "rig/procedure/procedure.hpp"

namespace rig {

/// The steps as written, checked as far as they can be without a bench. `variables` are those of the file.
[[nodiscard]] std::vector<Step> read_steps(const Node& node, const Variables& variables);

}  // namespace rig
