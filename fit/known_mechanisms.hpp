// SPDX-License-Identifier: MIT
#pragma once

#include "fit/bench/bench.hpp"

namespace fit {

/// Throws std::invalid_argument where the bench knows a mechanism that the catalogue does not have, or a
/// parameter by a wrong name: the right one would stay at its default, another bench than its file says.
void demand_catalogued(const Bench& bench);

}  // namespace fit
