// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/model/spread.hpp"
#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain {

/// Do ranges come in coarse steps? Then `rounding`; and the session knows what such steps do to means and
/// variances.
[[nodiscard]] std::optional<Suspect> find_coarse_steps(Reduced& reduced);

}  // namespace fit::explain
