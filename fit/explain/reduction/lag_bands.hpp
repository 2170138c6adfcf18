// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

namespace fit::explain {

/// Lags between scans, first to last, whose products are summed together: the autocovariance of noise fades
/// smoothly, so that long lags need no telling apart, and of white noise the sums are independent.
struct LagBand {
  int first, last;
};
constexpr std::array<LagBand, 9> lag_bands{
    {{0, 0}, {1, 1}, {2, 2}, {3, 3}, {4, 6}, {7, 12}, {13, 24}, {25, 48}, {49, 96}}};

using LagSums = std::array<double, lag_bands.size()>;

/// Sums of `of(lag)`, by bands, over the lags that n scans have.
template <class Of>
[[nodiscard]] LagSums sums_over_bands(int n, const Of& of) {
  LagSums sums{};
  for (std::size_t band = 0; band < lag_bands.size(); ++band)
    for (int lag = lag_bands[band].first; lag <= std::min(lag_bands[band].last, n - 1); ++lag)
      sums[band] += of(lag);
  return sums;
}

}  // namespace fit::explain
