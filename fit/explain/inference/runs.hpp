// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <vector>

namespace fit::explain {

/// A value at a place of a coordinate, and how much it counts.
struct WeighedValue {
  double at = 0, value = 0, weight = 1;
};

/// Weighted means of places, which rise, and of values.
struct RunMeans {
  std::vector<double> at, value;
};

/// Means over runs of `each` neighbours, longer where a cut would part places that are the same. What has no
/// weight is left out.
[[nodiscard]] RunMeans means_over_runs(std::vector<WeighedValue> list, std::size_t each);

}  // namespace fit::explain
