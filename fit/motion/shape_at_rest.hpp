// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <span>

#include "fit/motion/deskew.hpp"
#include "fit/motion/icp.hpp"
#include "fit/motion/pose2.hpp"

namespace fit {

/// The scene as a lidar at rest sees it: mean of many scans, and so the truth for scans of the same scene
/// while a stage turns the lidar. What the odometry of source B lacks.
class ShapeAtRest {
 public:
  /// A scan at rest, borrowed, and where the lidar was (mm, rad).
  struct Scan {
    const Sweep& sweep;
    Pose2 lidar;
  };

  /// Of no scene: it is empty.
  ShapeAtRest() = default;
  /// Scans in a row that were taken from one pose are averaged beam by beam.
  explicit ShapeAtRest(std::span<const Scan> scans);

  [[nodiscard]] bool empty() const { return surface_.points().empty(); }

  /// Root mean square distance (mm) of a scan's points, in the lidar's frame, from the scene's surfaces, once
  /// the whole scan is placed where it fits best, beginning at `guess`: of its shape alone, whatever is wrong
  /// about the lidar's place. Not a number if fewer than 50 points lie on surfaces.
  [[nodiscard]] double distance_of(std::span<const Eigen::Vector2d> points, const Pose2& guess) const;

 private:
  PointCloud surface_;
};

}  // namespace fit
