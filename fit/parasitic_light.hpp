// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

#include "fit/mechanism.hpp"
#include "fit/weakest_echo.hpp"

/// Light from inside the housing that is added to the echo: how far it moves the trigger depends on how
/// strong the echo is, and the receiver says how.
namespace fit {

[[nodiscard]] inline Parameter by_echo() { return even_shape("by_echo", -1, 1, 2); }

/// 1 at 1000 counts, and where the lidar gives no intensity.
[[nodiscard]] inline double beside_echo(const Circumstances& c, double by_echo) {
  return std::isfinite(c.intensity) ? std::pow(counts_of_echo(c.intensity) / 1000, by_echo) : 1;
}

}  // namespace fit
