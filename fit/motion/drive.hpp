// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <vector>

#include "fit/motion/odometry_runs.hpp"
#include "fit/motion/sweep_timing.hpp"

namespace fit {

/// A path rolled from wheel angles alone, at the wheels' own times.
Path path_from_wheels(const std::vector<TrackPose>& track, const RobotGeometry& robot);

struct DriveOptions {
  RobotGeometry guess;           ///< To start from where the recording holds no odometry.
  double least_way_mm = 100;     ///< Scans are matched once the robot has moved so far ...
  double least_turn_rad = 0.15;  ///< ... or turned so far,
  double longest_s = 2;          ///< ... or after this time, if it moved at all.
  /// In the end scans are matched at these multiples of the three as well.
  std::vector<double> lengths = {1, 2, 4, 8};
  std::optional<double> known_offset_s;  ///< Wheels' time minus scans' time; without it, estimated.
  OffsetOptions offset;
  int rounds = 4;  ///< Deskew, match, fit, and again with what was found.
  /// Limit of the error of the lidar's scale (data sheets: 1 % of the range): every length found contains it.
  double range_scale = 0.01;
  OdometryOptions fit;
};

/// The fit to scans matched at one length.
struct DriveLength {
  double multiple = 1;
  std::size_t samples = 0;
  double way_mm = 0, interval_s = 0;                      ///< Medians.
  Vector6 values = Vector6::Zero(), u = Vector6::Zero();  ///< u: leaving out one segment after the other.
  std::vector<Vector6> without;                           ///< The values without each segment.
  bool taken = false;
};

struct DriveFit {
  OdometryFit odometry;
  std::vector<WheelSample> samples;
  TimingEstimate timing;  ///< Order of the beams, each at its own best offset, from the agreement of scans.
  OffsetSearch coarse;    ///< By scans matched one after the other, before anything else is known.
  OffsetSearch offset;    ///< Wheels' time minus scans' time, where wheels and matches agree best.
  /// Standard uncertainties by leaving out one segment of the drive after the other, with Student's factor,
  /// in the order of RobotGeometry::vector().
  Vector6 jackknife_u = Vector6::Zero();
  std::vector<RunVerdict> segments;  ///< Of the drive, in order of time; those with slip are left out.
  std::vector<DriveLength> lengths;
  bool extrapolated = false;        ///< The values given are those that the lengths tend to.
  Vector6 drift = Vector6::Zero();  ///< From the length taken (extrapolated: the greatest) to those.
  double still_s = 0, moving_s = 0;
  Eigen::Vector3d still_noise =
      Eigen::Vector3d::Zero();  ///< RMS of matches while the robot stood: mm, mm, rad.
  std::size_t still_matches = 0, bad_matches = 0;
  std::size_t own_beams = 0;  ///< Left out: they see the robot itself.
  /// Stamps came late by chance and were replaced by even ones: of the scans, of the wheels.
  bool even_scans = false, even_wheels = false;
  double scan_jitter_s = 0;  ///< RMS of the scans' stamps from even ones.
  std::vector<RobotGeometry> rounds;
};

/// Calibrates wheels and lidar pose from a drive: wheel angles and scans of a recording. Scans are deskewed
/// by the wheels, scans some way apart are matched with each other (both ways, matches that disagree are left
/// out), segments at rest only tell the matches' noise, and what is found deskews the scans of the next
/// round. The clocks' offset comes first, from scans matched one after the other, which needs no wheels; then
/// the order of the beams, each at its own best offset. A match that falls short by some millimetres, or
/// wheels read at uncertain times, make lengths too small by a share that falls with the way: scans are
/// matched at several lengths and, if the values drift, extrapolated by `value + c / way`. Segments of the
/// drive with slip are left out, and the uncertainty is that of leaving out one segment after the other, with
/// the drift and the lidar's scale. Beams that see the robot itself are left out, and stamps that come late
/// by chance made even where wheels and matches then agree better. Throws std::invalid_argument when wheel
/// angles or motion are missing.
DriveFit fit_drive(const Recording& recording, const DriveOptions& options = {});

}  // namespace fit
