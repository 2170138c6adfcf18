// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace fit {

/// A table's value at `v`: linear between its places, which rise, and held beyond its ends. Not empty.
inline double linear_in(const std::vector<double>& at, const std::vector<double>& value, double v) {
  const auto next = std::ranges::upper_bound(at, v);
  if (next == at.begin()) return value.front();
  if (next == at.end()) return value.back();
  const auto i = static_cast<std::size_t>(next - at.begin());
  return value[i - 1] + (v - at[i - 1]) / (at[i] - at[i - 1]) * (value[i] - value[i - 1]);
}

}  // namespace fit
