// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace rig {

/// The median of a few values: of an even number, the mean of the middle two, which fit::median_of() leaves
/// out. Not a number of nothing.
[[nodiscard]] inline double middle_of(std::vector<double> values) {
  if (values.empty()) return std::nan("");
  const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, half);
  if (values.size() % 2 == 1) return *half;
  return (*half + *std::max_element(values.begin(), half)) / 2;
}

}  // namespace rig
