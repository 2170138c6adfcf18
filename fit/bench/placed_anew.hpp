// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include "fit/bench/bench.hpp"

namespace fit {

/// Whether the bench file says of a target that it is put up by hand for every shift (`placed_anew`): its
/// `u_mm` and `u_deg` hold for each placement on its own then.
[[nodiscard]] bool is_placed_anew(const Bench& bench, const std::string& target);

}  // namespace fit
