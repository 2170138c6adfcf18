// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

/// R(theta) (x, y): where a place on the stage is in the world frame, mm.
[[nodiscard]] inline Eigen::Vector2d on_stage_mm(const Circumstances& c, double x_mm, double y_mm) {
  const double cos = std::cos(c.stage_rad), sin = std::sin(c.stage_rad);
  return {cos * x_mm - sin * y_mm, sin * x_mm + cos * y_mm};
}

}  // namespace fit::mechanisms
