// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "fit/numeric/ransac.hpp"

namespace fit {

struct Circle {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double radius = 0;

  [[nodiscard]] double distance_of(const Eigen::Vector2d& p) const {
    return std::abs((p - centre).norm() - radius);
  }
};

struct CircleFit {
  Circle circle;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< Of (centre x, centre y, radius).
  double rms = 0;                                        ///< Of the distances from the circle.
  std::size_t points = 0;
  bool converged = true;
};

/// Linear least squares on x^2 + y^2 (Kasa 1976): one step, but biased towards small circles when the points
/// cover only a short arc. Kept as a start and to show that bias.
CircleFit fit_circle_algebraic(std::span<const Eigen::Vector2d> points);

/// Least squared distances from the circle, by Levenberg-Marquardt from the algebraic fit. Precondition: at
/// least three points not on a line.
CircleFit fit_circle(std::span<const Eigen::Vector2d> points);

/// RANSAC from three points with `first_tolerance`, again among its inliers with `second_tolerance` (the way
/// of the patent on right-angle wall calibration, source C), then fit_circle on all within that of its own
/// circle.
struct RansacCircle {
  CircleFit fit;
  std::vector<std::size_t> inliers;
};
std::optional<RansacCircle> find_circle(std::span<const Eigen::Vector2d> points, double first_tolerance = 20,
                                        double second_tolerance = 10, double largest_radius = 1e6);

}  // namespace fit
