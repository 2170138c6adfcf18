// SPDX-License-Identifier: MIT
#pragma once

#include "fit/bench.hpp"

namespace fit::explain {

/// Noise of one sample where the bench states none.
constexpr double unstated_noise_mm = 10;

/// Standard deviation of one sample that the bench states, mm; where it states none, hardly any knowledge.
[[nodiscard]] Estimate stated_noise(const Bench& bench);

}  // namespace fit::explain
