// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <vector>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::reduction {

/// The number that firmware or a driver delivers for whatever is farther away: beams beyond it all read
/// exactly that, without noise, and no beam reads more. Empty where there is none.
[[nodiscard]] std::optional<RangeLimit> range_limit(const Reduced& reduced);

/// Where beams of a standing stage look at targets that are so far away that noise may reach the limit.
[[nodiscard]] std::vector<Occluder> beyond(const Reduced& reduced, const RangeLimit& limit);

}  // namespace fit::explain::reduction
