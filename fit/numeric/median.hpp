// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace fit {

/// The upper median; 0 of nothing. Puts the values into another order.
[[nodiscard]] inline double median_of(std::span<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The same of values that nobody else needs.
[[nodiscard]] inline double median_of(std::vector<double>&& values) { return median_of(std::span(values)); }

/// The same; not a number of nothing.
[[nodiscard]] inline double median_or_nan(std::vector<double> values) {
  return values.empty() ? std::numeric_limits<double>::quiet_NaN() : median_of(std::span(values));
}

/// Of the squares of standard normal numbers: by this a median of squares becomes a variance.
constexpr double median_of_normal_squares = 0.4549;

}  // namespace fit
