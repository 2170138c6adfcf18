// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <vector>

#include "fit/numeric/angle.hpp"

namespace fit {

/// A pose in the plane: position in mm and heading in rad. As a transform it takes points of the moving frame
/// to the fixed one; `a * b` is "a, then b in a's frame" (the circled plus of Censi et al. 2013).
struct Pose2 {
  double x_mm = 0, y_mm = 0, heading_rad = 0;

  [[nodiscard]] Pose2 inverse() const {
    const double c = std::cos(heading_rad), s = std::sin(heading_rad);
    return {-c * x_mm - s * y_mm, s * x_mm - c * y_mm, -heading_rad};
  }
  [[nodiscard]] Eigen::Vector2d position() const { return {x_mm, y_mm}; }
};

/// Headings add up without wrapping: a track may turn more than once.
inline Pose2 operator*(const Pose2& a, const Pose2& b) {
  const double c = std::cos(a.heading_rad), s = std::sin(a.heading_rad);
  return {a.x_mm + c * b.x_mm - s * b.y_mm, a.y_mm + s * b.x_mm + c * b.y_mm, a.heading_rad + b.heading_rad};
}
inline Eigen::Vector2d operator*(const Pose2& a, const Eigen::Vector2d& p) {
  const double c = std::cos(a.heading_rad), s = std::sin(a.heading_rad);
  return {a.x_mm + c * p.x() - s * p.y(), a.y_mm + s * p.x() + c * p.y()};
}

/// Between two poses, linear in position and along the shorter arc in heading; `share` 0 gives a, 1 gives b,
/// outside that range it continues at the same rate.
Pose2 interpolate(const Pose2& a, const Pose2& b, double share);

/// A pose at a time.
struct TimedPose {
  double time_s = 0;
  Pose2 pose;
};

/// A path known at some times: pose at any time in between, piecewise linear, so that it follows a curve.
class Path {
 public:
  Path() = default;
  /// Poses in any order; of several at the same time the last counts. Headings may be wrapped: neighbours are
  /// joined along the shorter arc.
  explicit Path(std::vector<TimedPose> poses);

  [[nodiscard]] bool empty() const { return poses_.empty(); }
  [[nodiscard]] double begin_s() const { return poses_.front().time_s; }
  [[nodiscard]] double end_s() const { return poses_.back().time_s; }
  /// Before the first and after the last pose the motion of the nearest interval goes on for at most
  /// `coast_s`, then stands still. Precondition: not empty.
  [[nodiscard]] Pose2 at(double time_s) const;
  [[nodiscard]] const std::vector<TimedPose>& poses() const { return poses_; }

  static constexpr double coast_s = 0.2;

 private:
  std::vector<TimedPose> poses_;
};

}  // namespace fit
