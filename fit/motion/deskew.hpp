// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fit/motion/pose2.hpp"
#include "fit/recording.hpp"

namespace fit {

/// One echo of a sweeping lidar, in the lidar's own frame at the moment it was taken.
struct SweptPoint {
  Eigen::Vector2d at_mm = Eigen::Vector2d::Zero();
  double share = 0;  ///< Of the sweep that had passed: 0 first beam, 1 end of the sweep.
  std::uint32_t beam = 0;
};

/// One scan as it was swept. Only beams with an echo.
struct Sweep {
  double begin_s = 0, duration_s = 0;
  std::vector<SweptPoint> points;

  [[nodiscard]] double time_s(double share) const { return begin_s + share * duration_s; }
};

/// A scan of a recording as a sweep, in order of beams. Times are host time.
Sweep sweep_of(const ScanView& scan, const CaptureInfo& capture, const LidarGeometry& lidar);

/// How what carries the lidar moved, as the recording tells it: odometry if it has poses; else the stage
/// angles and rates of the captures (about the world's origin) if any has a rate; else the stage's track;
/// else the captures' angles.
struct Carrier {
  Path path;
  bool drifts = true;  ///< Odometry does, a stage does not.
};
Carrier carrier_of(const Recording& recording);

/// Relation of the beams' times to the path's times.
struct SweepTiming {
  double offset_s = 0;    ///< Added to a beam's time to get the path's time.
  bool reversed = false;  ///< The driver lists the beams against the order in which they were taken.

  [[nodiscard]] double path_time(const Sweep& sweep, double share) const {
    return sweep.time_s(reversed ? 1 - share : share) + offset_s;
  }
};

/// Odometry-aided correction (source B, method 1): every point in the lidar's frame at `reference_share` of
/// the sweep, `p' = P(t_ref)^-1 P(t_i) p_i` with P the pose of the lidar = carrier's pose times `lidar`.
std::vector<Eigen::Vector2d> deskew(const Sweep& sweep, const Path& path, const Pose2& lidar,
                                    const SweepTiming& timing = {}, double reference_share = 0);

}  // namespace fit
