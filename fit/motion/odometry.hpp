// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "fit/motion/pose2.hpp"
#include "fit/motion/steering.hpp"

namespace fit {

/// One interval between two scans of a robot: how fast its wheels turned on average and how the lidar moved
/// in its own frame according to scan matching.
struct WheelSample {
  double interval_s = 0;
  double left_rad_s = 0, right_rad_s = 0;
  Pose2 match;
  /// Standard uncertainties of the match relative to those of the other samples; only their ratios matter.
  double relative_u_mm = 1, relative_u_rad = 1;
  /// What the wheels did in each piece of the interval, one after the other, as the steering measures it (two
  /// driven wheels: how far the left and the right one turned, rad); empty: left and right, evenly all the
  /// time.
  std::vector<Eigen::Vector2d> pieces = {};
  double begin_s = 0;   ///< When it began, where that is known.
  std::size_t run = 0;  ///< Which of several drives it belongs to.
};

/// What is sought, in the order of the covariance. For another steering than two driven wheels the first
/// three hold that steering's parameters, in its order.
struct RobotGeometry {
  double left_radius_mm = 0, right_radius_mm = 0;  ///< Wheel radii.
  double separation_mm = 0;                        ///< Of the wheels.
  Pose2 lidar;  ///< On the robot, whose origin is midway between the wheels of the axle that is not steered.
  const Steering* steering = nullptr;  ///< Null: two driven wheels.

  [[nodiscard]] Eigen::Matrix<double, 6, 1> vector() const;
  static RobotGeometry from(const Eigen::Matrix<double, 6, 1>& v, const Steering* steering = nullptr);
};

/// Motion of the robot over the sample's interval: an arc, or one arc for each of its pieces.
Pose2 wheel_motion(const RobotGeometry& robot, const WheelSample& sample);
/// Motion of the lidar in its own frame: (-)l (+) r (+) l.
Pose2 lidar_motion(const RobotGeometry& robot, const WheelSample& sample);

struct OdometryOptions {
  int rounds = 4;               ///< Times the worst samples are dropped before the final fit.
  double outlier_share = 0.01;  ///< Of the samples left, dropped in each round.
  /// Maximises the likelihood over all six parameters at once, starting from the closed form.
  bool refine = false;
  const Steering* steering = nullptr;  ///< Null: two driven wheels.
};

struct OdometryRound {
  std::size_t samples = 0;
  RobotGeometry robot;
  Eigen::Vector3d residual_rms = Eigen::Vector3d::Zero();  ///< x mm, y mm, heading rad of these samples.
};

/// How the robot moved: shares of the samples.
struct MotionShares {
  double still = 0, straight = 0, on_the_spot = 0, curve = 0;
};

struct OdometryFit {
  RobotGeometry robot;
  /// Inverse Fisher information at the estimate, mm and rad, in the order of RobotGeometry::vector().
  /// Infinite variance where the samples carry no information.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  /// The same if noise is taken from the residuals of the samples left after the first round: what still
  /// contains many outliers, and agrees with the covariances that Censi et al. published.
  Eigen::Matrix<double, 6, 6> first_round_covariance = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Vector3d noise = Eigen::Vector3d::Zero();  ///< Standard deviation of a match with relative_u 1.
  std::vector<OdometryRound> rounds;                ///< The last is the final fit.
  std::vector<bool> used;                           ///< For every sample given.
  MotionShares motion;
  std::array<bool, 6> determined{};       ///< Each parameter.
  std::vector<std::string> undetermined;  ///< Sentences; empty when all six parameters are determined.
};

/// Simultaneous calibration of odometry and lidar pose (Censi, Franchi, Marchionni, Oriolo, IEEE T-RO 29
/// (2013), algorithm 1): J21, J22 by weighted linear least squares from the headings; wheel separation and
/// lidar pose from a quadratic form with one quadratic constraint, in closed form; the worst share of samples
/// by chi is dropped, four times; covariance from the Fisher information. Throws std::invalid_argument for
/// fewer than 20 samples. Data that leave parameters unobservable are not refused: see `undetermined`.
OdometryFit fit_odometry(const std::vector<WheelSample>& samples, const OdometryOptions& options = {});

/// Each sample's difference between measured and predicted lidar motion: x mm, y mm, heading rad.
Eigen::Vector3d odometry_residual(const RobotGeometry& robot, const WheelSample& sample);

/// Their root mean squares.
Eigen::Vector3d residual_rms(const std::vector<WheelSample>& samples, const RobotGeometry& robot);

/// d(lidar_motion)/d(parameters): mm and rad, by central differences.
Eigen::Matrix<double, 3, 6> motion_jacobian(const RobotGeometry& robot, const WheelSample& sample);

/// Inverse of an information of the parameters; large, but finite, where there is none.
Eigen::Matrix<double, 6, 6> covariance_of_robot(const Eigen::Matrix<double, 6, 6>& information,
                                                const RobotGeometry& robot);

/// Gauss-Newton's step, short where there is next to no information.
Eigen::Matrix<double, 6, 1> damped_step(const Eigen::Matrix<double, 6, 6>& information,
                                        const Eigen::Matrix<double, 6, 1>& gradient,
                                        const RobotGeometry& robot);

/// Sets `determined` and `undetermined` by the fit's covariance and motion. `turns_unknown`: how the wheels
/// turn the robot left no trace.
void judge_determined(OdometryFit& fit, bool turns_unknown);

}  // namespace fit
