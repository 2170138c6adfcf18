// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "fit/bench/accuracy.hpp"
#include "fit/numeric/estimate.hpp"
#include "fit/range/circle.hpp"
#include "fit/range/line.hpp"
#include "fit/recording.hpp"

namespace fit {

struct WallOptions {
  std::string front, side;             ///< Names of the two boards; empty: the bench's first two.
  double tolerance_mm = 20;            ///< Of the RANSAC for lines.
  std::size_t scans_per_capture = 50;  ///< Scans of a capture that make points of the trajectory, at most.
  DeviceAccuracy accuracy;  ///< Deviations that the joint fit finds together with the walls; u = 0: none.
};

/// A systematic deviation of stage or lidar in the joint fit: expected to be zero, and what the captures say.
struct WallEffect {
  AccuracyLine line;
  Estimate found;  ///< In units of its standard uncertainty: {0, 1} where the captures say nothing of it.
  /// What one standard uncertainty of it adds to the joint parameters.
  Eigen::Matrix<double, 6, 1> share = Eigen::Matrix<double, 6, 1>::Zero();
};

/// A board as the bench states it: direction of its normal away from the axis, and distance from the axis.
struct WallInBench {
  std::string name;
  Line2 line;
  double u_rad = 0;
};

/// Both walls seen in one scan (or in the mean of a capture), in the lidar's frame.
struct WallObservation {
  double stage_rad = 0;
  double off_rad = 0;                  ///< Deviation of that angle, as the joint fit found it.
  std::size_t capture = 0;             ///< Of all sources' captures, counted through.
  std::optional<LineFit> walls[2];     ///< Front, side.
  double square_range_mm[2] = {0, 0};  ///< Of the beam that meets the wall squarely; 0: none.
};

/// A way to the offset of the lidar from the axis.
struct WallCircle {
  std::string way;
  std::optional<CircleFit> circle;
  Estimate radius_mm, direction_rad;  ///< u: noise, and what the way makes of it; not what the devices do. 0:
                                      ///< not known.
  std::size_t points = 0, inliers = 0;
};

struct WallFit {
  WallInBench walls[2];
  /// Mounting angle (yaw of the lidar against the front wall at stage angle 0), lidar's x and y on the stage,
  /// distances of front and side wall from the axis, and deviation of the corner from the bench's.
  Eigen::Matrix<double, 6, 1> joint = Eigen::Matrix<double, 6, 1>::Zero();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 6> from_noise =
      Eigen::Matrix<double, 6, 6>::Zero();  ///< Of `joint` by the noise of single ranges.
  Eigen::Matrix<double, 6, 6> from_ranges =
      Eigen::Matrix<double, 6, 6>::Zero();  ///< The same, with the scatter between captures.
  std::vector<WallEffect> effects;          ///< Those that were allowed for, in parts (sine and cosine ...).
  double capture_freedom = 0;               ///< Degrees of freedom of the scatter between captures.
  Estimate radius_mm, direction_rad;
  double range_noise_mm = 0;  ///< Standard deviation of one range, from the scatter of the beams' means.
  double capture_inflation =
      1;                      ///< How much wider the scatter between captures made the uncertainty, at most.
  std::size_t beams = 0;      ///< Means of beams used.
  Estimate patent_angle_rad;  ///< Mean slope of the front wall over the repeats at stage angle 0.
  std::size_t repeats = 0;
  std::vector<WallCircle> ways;           ///< Both walls in every scan (geometric, algebraic), single beam.
  std::vector<WallObservation> means;     ///< One a capture, deviations taken off.
  std::vector<WallObservation> measured;  ///< The same as it was measured.
  std::vector<Eigen::Vector2d> trajectory,
      single_beam;  ///< In the wall frame: minus the distances from the walls.
  std::vector<std::string> notes;
};

/// Right-angle wall calibration (source C) on a stage: the lidar turns in front of two walls. Both walls are
/// found by RANSAC and fitted by least squares in every scan; the joint least-squares fit of mounting angle,
/// offset and walls uses the means of all beams, weighted by incidence, its covariance widened where captures
/// scatter more than their noise, with the devices' systematic deviations as parameters of known size; the
/// patent's circle through the positions, from both walls and from single beams, is given for comparison;
/// deviations found are taken off before. Throws std::invalid_argument saying what is missing.
WallFit fit_wall(const std::vector<const Recording*>& recordings, const WallOptions& options = {});

}  // namespace fit
