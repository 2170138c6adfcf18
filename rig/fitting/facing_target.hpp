// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <string>

#include "fit/recording.hpp"

namespace rig {

/// A target as it stood during a capture, in the lidar's frame: what of it faces the lidar squarely.
struct FacingTarget {
  Eigen::Vector2d from, to, normal;  ///< Ends, of a round one its tangent's; unit vector of the square beam.
  double distance_mm = 0, normal_rad = 0;
  double radius_mm = 0;     ///< Of a round one.
  double u_normal_rad = 0;  ///< Standard uncertainty of the normal's direction by the bench file.
  double u_mount_mm = 0;    ///< Of the distance, by where the lidar sits on the stage.

  /// Whether a beam in this direction meets the middle part.
  [[nodiscard]] bool meets(double direction_rad) const;
  /// Range along a beam that is off the normal by so much, less the distance; NaN where it passes by. Of a
  /// plane d (1 / cos off - 1); of a circle of radius R, D = d + R, D cos off - sqrt(R^2 - D^2 sin^2 off) -
  /// d.
  [[nodiscard]] double excess_mm(double off_rad) const;
  /// Its derivative, mm/rad.
  [[nodiscard]] double excess_per_rad(double off_rad) const;
};

[[nodiscard]] FacingTarget facing_target(const fit::Target& target, const fit::CaptureInfo& capture,
                                         const fit::Mount& mount);

struct SeenNormal {
  double rad = 0, u_rad = 0;
  bool from_data = false;
  std::string said;  ///< Where the target is not what the bench file says.
};

/// Direction of the normal from what was seen of the target, if that is better than the bench file knows it.
[[nodiscard]] SeenNormal seen_normal(const fit::Recording& recording, std::size_t capture,
                                     const FacingTarget& target);

}  // namespace rig
