// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include "fit/explain/reduction/lag_bands.hpp"

/// Autocorrelated noise, AR(1): of two values k steps apart the correlation is rho^k.
namespace fit::explain::model {

/// Expected sums of lagged products, by bands of lags, of n values of variance one about their own mean.
[[nodiscard]] LagSums lagged_of(int n, double rho);

/// Number of pairs of n values in every band of lags.
[[nodiscard]] LagSums pairs_of(int n);

using LagCovariance = Eigen::Matrix<double, lag_bands.size(), lag_bands.size()>;

/// Covariance of the sums of lagged products, of n values of variance one of which a share is AR(1) and the
/// rest is white (Bartlett 1946: that of c_j and c_k is the sum over m of r_m r_(m+k-j) + r_(m+k) r_(m-j), by
/// the number of pairs).
[[nodiscard]] LagCovariance covariance_of_lagged(int n, double rho, double share);

/// How many independent values say as much of the variance as one of such noise does: the square of its
/// correlations, summed over all lags, is what makes squares scatter more (Bartlett 1946).
[[nodiscard]] double worth_for_variance(double rho, double share);
/// By which the expected sample variance of n values falls short of theirs: they follow their own mean.
[[nodiscard]] double share_in_sample_variance(int n, double rho, double share);
/// Spectral density of such noise of variance one at a phase from value to value; of white noise it is one.
[[nodiscard]] double spectral_density(double phase_rad, double rho, double share);

/// What the correlation of n values adds to the variance of their mean, in units of that which n values
/// independent ones have.
[[nodiscard]] double added_to_mean(int n, double rho);

}  // namespace fit::explain::model
