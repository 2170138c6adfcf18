// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <map>
#include <span>
#include <vector>

#include "fit/deskew.hpp"
#include "fit/icp.hpp"
#include "fit/pose2.hpp"

namespace fit {

/// The scene as a lidar at rest sees it: mean of many scans, and so the truth for scans of the same scene
/// while a stage turns the lidar. What the odometry of source B lacks.
class ShapeAtRest {
 public:
  /// A scan at rest, the lidar at that pose (mm, rad). Scans of one pose are averaged beam by beam.
  void add(const Sweep& scan, const Pose2& lidar);
  /// Call once, after the last scan.
  void finish();
  [[nodiscard]] bool empty() const { return surface_.points().empty(); }

  /// Root mean square distance (mm) of a scan's points, in the lidar's frame, from the scene's surfaces, once
  /// the whole scan is placed where it fits best, beginning at `guess`: of its shape alone, whatever is wrong
  /// about the lidar's place. Not a number if fewer than 50 points lie on surfaces.
  [[nodiscard]] double distance_of(std::span<const Eigen::Vector2d> points, const Pose2& guess) const;

 private:
  struct Beam {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    int count = 0;
  };
  struct Stand {
    Pose2 lidar;
    int scans = 0;
    std::map<std::uint32_t, Beam> beams;
  };
  std::vector<Stand> stands_;
  PointCloud surface_;
};

}  // namespace fit
