// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::model {

/// Whether the beam of a cell may go past its target, so that a missing echo tells nothing: at a corner, or
/// near an edge, unless its neighbours on both sides, farther than edges blur, see the target as well.
[[nodiscard]] bool may_miss_its_target(const Reduced& reduced, std::size_t cell);

}  // namespace fit::explain::model
