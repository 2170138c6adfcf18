// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/deskew.hpp"
#include "fit/odometry.hpp"

namespace fit {

/// A path rolled from wheel angles alone, at the wheels' own times.
Path path_from_wheels(const std::vector<TrackPose>& track, const RobotGeometry& robot);

struct DriveOptions {
  RobotGeometry guess;           ///< To start from where the recording holds no odometry.
  double least_way_mm = 100;     ///< Scans are matched once the robot has moved so far ...
  double least_turn_rad = 0.15;  ///< ... or turned so far,
  double longest_s = 2;          ///< ... or after this time, if it moved at all.
  double widest_offset_s = 0.2;  ///< Of the clocks of scans and wheels.
  int rounds = 4;                ///< Deskew, match, fit, and again with what was found.
  OdometryOptions fit;
};

struct DriveFit {
  OdometryFit odometry;
  std::vector<WheelSample> samples;
  TimingEstimate timing;  ///< Order of the beams, and a first offset, from the agreement of scans.
  Estimate offset_s;      ///< Wheels' time minus scans' time, where wheels and matches agree best.
  /// Standard uncertainties by leaving out one stretch of the drive after the other (jackknife over 12), in
  /// the order of RobotGeometry::vector().
  Eigen::Matrix<double, 6, 1> jackknife_u = Eigen::Matrix<double, 6, 1>::Zero();
  double still_s = 0, moving_s = 0;
  Eigen::Vector3d still_noise =
      Eigen::Vector3d::Zero();  ///< RMS of matches while the robot stood: mm, mm, rad.
  std::size_t still_matches = 0, bad_matches = 0;
  std::vector<RobotGeometry> rounds;
};

/// Calibrates wheels and lidar pose from a drive: wheel angles and scans of a recording. Scans are deskewed
/// by the wheels, scans some way apart are matched with each other (both ways, matches that disagree are left
/// out), stretches at rest only tell the matches' noise, and what is found deskews the scans of the next
/// round. The covariance counts overlapping samples once and is widened to the jackknife's. Throws
/// std::invalid_argument when wheel angles or motion are missing.
DriveFit fit_drive(const Recording& recording, const DriveOptions& options = {});

}  // namespace fit
