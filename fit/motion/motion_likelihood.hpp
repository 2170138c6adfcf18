// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "fit/motion/odometry.hpp"

namespace fit {

/// What makes watched motions differ from those of the wheels: variances, of x and y in mm², of heading in
/// rad².
struct MotionNoise {
  struct Component {
    /// Of every sample by itself, times its relative_u squared: scan matches.
    double sample = 0;
    /// For every radian that a wheel turns; adds up on the way: slip, a rough floor.
    double walk = 0;
    /// Of every watched pose: what one sample has too much, the next has too little. Motion capture.
    double pose = 0;
  };
  std::array<Component, 3> of;
  /// Of the time at which a pose was watched, by the wheels' clock, s²; its correlation falls as
  /// exp(-t / time_lasts_s). Counts by the speed.
  double time = 0, time_lasts_s = 1;
};

/// What some samples say of the parameters: information (inverse covariance) and gradient of the
/// log-likelihood, at the robot of linearise().
struct MotionEquations {
  std::size_t samples = 0;
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 1> gradient = Eigen::Matrix<double, 6, 1>::Zero();
};

/// The likelihood of watched motions under one robot: residuals are Gaussian, and of samples that follow each
/// other correlated through the pose between them,
///
///     e_k = sample_k + walk_k + (pose + speed time)_k - (pose + speed time)_(k-1).
///
/// x, y and heading are taken as independent. The errors of the pose and of its time are the state of a
/// Kalman filter, whose innovations are independent. An innovation beyond six standard deviations (a slip, a
/// jump of the motion capture) has its variance raised to its square.
class MotionLikelihood {
 public:
  /// `poses`: neighbouring samples share a watched pose; else every sample is by itself.
  MotionLikelihood(const std::vector<WheelSample>& samples, bool poses);

  /// Takes residuals and their derivatives at this robot.
  void linearise(const RobotGeometry& robot);
  /// Maximises the likelihood over the noise, at the robot of linearise().
  void estimate_noise();

  [[nodiscard]] const MotionNoise& noise() const { return noise_; }
  void take_noise(const MotionNoise& noise) { noise_ = noise; }
  /// By group; `groups` has one for each sample, counted from 0.
  [[nodiscard]] std::vector<MotionEquations> equations(const std::vector<std::size_t>& groups) const;

 private:
  using Row = Eigen::Matrix<double, 7, 1>;  ///< Residual and its derivatives.
  template <int columns, class Visit>
  void filter(std::size_t component, const MotionNoise& noise, Visit visit) const;
  [[nodiscard]] double minus_log_likelihood(std::size_t component, const MotionNoise& noise) const;
  [[nodiscard]] MotionNoise::Component first_guess(std::size_t component) const;
  void raise_outliers(std::size_t component);

  const std::vector<WheelSample>* samples_;
  bool poses_;
  std::vector<bool> follows_;   ///< The sample before it.
  std::vector<double> turned_;  ///< rad that a wheel turned in a sample.
  std::vector<Row> rows_[3];    ///< Of x, y and heading.
  /// Speed at the sample's begin and end by the wheels: mm/s, rad/s.
  std::vector<double> at_begin_[3], at_end_[3];
  std::vector<double> outlier_[3];  ///< Variance that is added for it.
  MotionNoise noise_;
};

}  // namespace fit
