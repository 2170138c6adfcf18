// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "fit/estimate.hpp"
#include "fit/icp.hpp"
#include "fit/pose2.hpp"
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

struct TimingEstimate {
  SweepTiming timing;
  Estimate offset_s;  ///< With its uncertainty, by resampling the pairs of scans it is made from.
  bool determined = false;
  double disagreement_mm = 0;        ///< Of overlapping scans, at the best timing.
  double disagreement_other_mm = 0;  ///< At the best timing with the other order of beams; 0: not tried.
  std::vector<double> tried_s, score_mm;
};

struct TimingOptions {
  double widest_s = 0.2;         ///< Offsets up to this are tried, both ways.
  std::optional<bool> reversed;  ///< Order of the beams; without it, judged: reversed only if clearly better.
  bool drifts = true;            ///< Path of a stage (false): scans of different captures are compared too.
  double about_s = 0;            ///< The offset in the middle of those tried.
  int steps = 40;                ///< Offsets tried on either side.
};

/// Finds the time offset at which scans, placed by the path alone, agree best: scans four apart, or, on a
/// stage, scans from about the same angle taken while it turned at different rates. Only motion that differs
/// tells it.
TimingEstimate estimate_timing(std::span<const Sweep> sweeps, const Path& path, const Pose2& lidar,
                               const TimingOptions& options = {});

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
