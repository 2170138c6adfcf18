// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>

#include "fit/mechanism.hpp"

/// What mechanisms share in which light of the housing overlaps with the echo: `amplitude_mm`, `reach_mm` and
/// `power`. That light fades behind the pulse. On a sloping edge a level shifts the crossing by itself over
/// the slope, so that a weak echo is shifted more: by the counts, or, behind a compressing receiver, a power
/// of them of up to 2.5. Optics that see the near part only partly shift all echoes alike.
namespace fit {

[[nodiscard]] inline Parameter power_of_housing_light(int starts) {
  return {.name = "power",  // of 1000 counts over the echo's
          .role = Parameter::Role::shape,
          .lower = 0,
          .upper = 2.5,
          .starts = starts,
          .logarithmic = false};
}

/// The shift in units of what moves an echo of 1000 counts at no distance; where nothing was counted, all
/// echoes are alike.
[[nodiscard]] inline double share_of_housing_light(const Circumstances& c, double reach_mm, double power) {
  constexpr double reference_counts = 1000, weakest_counts = 10;
  const double faded = std::exp(-c.range_mm / reach_mm);
  if (!std::isfinite(c.intensity)) return faded;
  return faded * std::pow(reference_counts / std::max(weakest_counts, c.intensity), power);
}

}  // namespace fit
