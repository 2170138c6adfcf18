// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>

namespace fit::explain::model {

/// Covariance of a range (mm) and an angle (rad) by their information; of one alone where they are the same,
/// or the other does not show.
[[nodiscard]] inline Eigen::Matrix2d covariance_of(const Eigen::Matrix2d& information) {
  constexpr double same = 1e-9;
  const double range = information(0, 0), angle = information(1, 1);
  if (information.determinant() > same * range * angle) return information.inverse();
  Eigen::Matrix2d alone = Eigen::Matrix2d::Zero();
  if (range > 0)
    alone(0, 0) = 1 / range;
  else if (angle > 0)
    alone(1, 1) = 1 / angle;
  return alone;
}

}  // namespace fit::explain::model
