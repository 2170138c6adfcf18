// SPDX-License-Identifier: MIT
#pragma once

#include <array>

/// Noise with memory, AR(1): of two values k steps apart the correlation is rho^k.
namespace fit::explain::spread {

/// Expected sums of lagged products of n demeaned values of variance one, lags 0..3.
[[nodiscard]] std::array<double, 4> lagged_of(int n, double rho);

/// What the pairs of n values that are `lag` apart add to the variance of their mean, in units of that which
/// n values without memory have.
[[nodiscard]] double pairs_at(int lag, int n, double rho);

}  // namespace fit::explain::spread
