// SPDX-License-Identifier: MIT
#pragma once

#include <numeric>
#include <span>

namespace fit {

/// Of one value at least.
[[nodiscard]] inline double mean_of(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

}  // namespace fit
