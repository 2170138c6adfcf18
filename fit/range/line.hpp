// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "fit/numeric/ransac.hpp"

namespace fit {

/// A line in the plane, seen from the origin: n . p = distance with n = (cos normal, sin normal); the normal
/// points from the origin to the line.
struct Line2 {
  double normal_rad = 0, distance_mm = 0;

  [[nodiscard]] Eigen::Vector2d normal() const { return {std::cos(normal_rad), std::sin(normal_rad)}; }
  [[nodiscard]] double offset_of(const Eigen::Vector2d& p) const { return normal().dot(p) - distance_mm; }
};

struct LineFit {
  Line2 line;
  /// Of (normal_rad, distance_mm), from the scatter of the points about the line.
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  double rms_mm = 0;
  std::size_t points = 0;
};

/// The line with the least squared distances (total least squares). Precondition: at least two points apart.
LineFit fit_line(std::span<const Eigen::Vector2d> points);

/// RANSAC for the line that most points agree with, then fit_line on those. Nothing with fewer than three.
struct RansacLine {
  LineFit fit;
  std::vector<std::size_t> inliers;
};
std::optional<RansacLine> find_line(std::span<const Eigen::Vector2d> points, const RansacOptions& options);

}  // namespace fit
