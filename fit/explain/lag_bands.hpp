// SPDX-License-Identifier: MIT
#pragma once

#include <array>

namespace fit::explain {

/// Lags between scans, first to last, whose products are summed together: the autocovariance of noise fades
/// smoothly, so that long lags need no telling apart, and of white noise the sums are independent.
struct LagBand {
  int first, last;
};
constexpr std::array<LagBand, 9> lag_bands{
    {{0, 0}, {1, 1}, {2, 2}, {3, 3}, {4, 6}, {7, 12}, {13, 24}, {25, 48}, {49, 96}}};

using LagSums = std::array<double, lag_bands.size()>;

}  // namespace fit::explain
