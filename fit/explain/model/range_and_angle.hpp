// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>
#include <algorithm>

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

/// A range and an angle that several values have in common, by weighted least squares. A value's `unit` is
/// what it changes by 1 mm of the range, and by 1 rad of the angle.
struct RangeAndAngle {
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();

  void add(const Eigen::Vector2d& unit, double mm, double weight) {
    information += weight * unit * unit.transpose();
    sum += weight * mm * unit;
  }
  /// What a value has of them, mm.
  [[nodiscard]] double mm(const Eigen::Vector2d& unit) const {
    return unit.dot(covariance_of(information) * sum);
  }
  /// Of the variance of a value that was added, when they are taken off.
  [[nodiscard]] double share_left(const Eigen::Vector2d& unit, double weight) const {
    return std::max(0.0, 1 - weight * unit.dot(covariance_of(information) * unit));
  }
};

}  // namespace fit::explain::model
