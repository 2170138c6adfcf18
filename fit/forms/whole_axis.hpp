// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/model/unnamed.hpp"

namespace fit::explain::forms {

/// Of forms that act along all of one coordinate and no other: its middle, and from there to its ends.
[[nodiscard]] inline std::vector<Shape> all_along(const Axis& axis, Coordinate coordinate) {
  if (axis.coordinate != coordinate) return {};
  return {{.at = (axis.low + axis.high) / 2, .length = (axis.high - axis.low) / 2}};
}

}  // namespace fit::explain::forms
