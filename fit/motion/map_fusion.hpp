// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "fit/motion/deskew.hpp"
#include "fit/motion/icp.hpp"

namespace fit {

struct FusionOptions {
  SweepTiming timing;
  double odometry_u = 0.1;   ///< Relative standard uncertainty of odometry's motion over one sweep.
  double odometry_u_mm = 1;  ///< And its floor.
  double odometry_u_rad = 0.001;
  double cell_mm = 20;        ///< The map keeps a few points in each cell of this size.
  double keyframe_mm = 100;   ///< The map grows when the lidar has moved so far ...
  double keyframe_rad = 0.1;  ///< ... or turned so far.
  IcpOptions icp;
};

struct FusedSweep {
  Pose2 begin, end;  ///< Of the lidar in the map, at the first beam taken and at the end of the sweep.
  std::vector<Eigen::Vector2d> map_mm;  ///< The sweep's points in the map.
  double noise_mm = 0, observability = 0;
  int iterations = 0;
  bool matched = false;  ///< False for the first sweep and where nothing fits: odometry alone.
};

/// Fusion of odometry with ICP (source B, method 2): each sweep is placed and deskewed by odometry, matched
/// to the map of those before, what odometry got wrong is spread linearly over the beams, and this repeats
/// until it converges. Where the scene does not tell (a corridor), odometry rules.
class Fusion {
 public:
  Fusion(Path path, const Pose2& lidar, FusionOptions options = {});
  ~Fusion();
  Fusion(const Fusion&) = delete;
  Fusion& operator=(const Fusion&) = delete;
  FusedSweep add(const Sweep& sweep);
  [[nodiscard]] const PointCloud& map() const;

 private:
  struct Map;
  Path path_;
  Pose2 lidar_, carried_;  ///< carried_: from odometry's frame to the map's.
  Eigen::Matrix3d carried_covariance_;
  FusionOptions options_;
  std::unique_ptr<Map> map_;
  std::optional<Pose2> last_keyframe_;
};

/// How crisp a map is.
struct Crispness {
  double thickness_mm = 0;  ///< Median standard deviation of the points across the walls they lie on.
  double mean_thickness_mm = 0;
  double entropy = 0;  ///< Mean log of the spread of the points about each other (nats; smaller is crisper).
  std::size_t judged = 0;
};

/// Judges at most `most` points, evenly chosen, by their neighbours within `radius_mm`.
Crispness crispness(std::span<const Eigen::Vector2d> map, double radius_mm = 150, std::size_t most = 4000);

}  // namespace fit
