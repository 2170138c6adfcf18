// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>

namespace fit::explain {

/// From the least to the largest of some values, of those that are finite.
struct Extent {
  double low = 1e300, high = -1e300;

  void add(double value) {
    if (!std::isfinite(value)) return;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  [[nodiscard]] double length() const { return high - low; }
};

}  // namespace fit::explain
