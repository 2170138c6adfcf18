// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/lag_bands.hpp"

/// Noise with memory, AR(1): of two values k steps apart the correlation is rho^k.
namespace fit::explain::model {

/// Expected sums of lagged products, by bands of lags, of n values of variance one about their own mean.
[[nodiscard]] LagSums lagged_of(int n, double rho);

/// Number of pairs of n values in every band of lags.
[[nodiscard]] LagSums pairs_of(int n);

/// What the correlation of n values adds to the variance of their mean, in units of that which n values
/// without memory have.
[[nodiscard]] double added_to_mean(int n, double rho);

}  // namespace fit::explain::model
