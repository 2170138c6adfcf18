// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <numbers>

namespace fit {

inline constexpr double pi = std::numbers::pi;
inline constexpr double rad_per_deg = pi / 180;
inline constexpr double deg_per_rad = 180 / pi;

/// The same direction, within (-pi, pi].
inline double wrap_angle(double rad) {
  if (std::abs(rad) < pi) return rad;  // mostly, and ten times as quick
  const double wrapped = std::remainder(rad, 2 * pi);
  return wrapped <= -pi ? wrapped + 2 * pi : wrapped;
}

}  // namespace fit
