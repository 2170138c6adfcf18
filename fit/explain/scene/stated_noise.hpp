// SPDX-License-Identifier: MIT
#pragma once

#include "fit/bench/bench.hpp"
#include "fit/mechanism.hpp"

namespace fit::explain {

/// Noise of one sample where the bench states none.
constexpr double unstated_noise_mm = 10;

/// Standard deviation of one sample that the bench states, mm; where it states none, hardly any knowledge.
[[nodiscard]] Estimate stated_noise(const Bench& bench);

/// The mechanism that bench files state it by, which is also what more of it is called: that is no other
/// physics beside it.
inline constexpr const char* constant_noise = "range-noise";
[[nodiscard]] bool is_constant_noise(const Mechanism& mechanism);
/// Puts what was found in place of what the bench states, where it states any.
void state_noise(Bench& bench, double sigma_mm);

}  // namespace fit::explain
