// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstddef>

#include "fit/mechanism.hpp"

namespace fit {

/// Mean range, by its light, of all that a beam of that standard half width meets, less that of its middle:
/// between the widths that circumstances know, and with the square of the width below them.
[[nodiscard]] inline double spread_at_mm(const Circumstances& c, double width_rad) {
  if (width_rad < wide_beams_rad[0]) return c.spread_mm[0] * std::pow(width_rad / wide_beams_rad[0], 2);
  const std::size_t k = width_rad < wide_beams_rad[1] ? 0 : 1;
  return std::lerp(c.spread_mm[k], c.spread_mm[k + 1],
                   (width_rad - wide_beams_rad[k]) / (wide_beams_rad[k + 1] - wide_beams_rad[k]));
}

/// The share of it to which receivers differ.
inline constexpr double spread_error = 0.25;

}  // namespace fit
