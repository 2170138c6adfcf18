// SPDX-License-Identifier: MIT
#pragma once
// Noise and time offsets of matched wheel samples. For fit/odometry_runs.cpp and fit/odometry_offset.cpp
// only.

#include <Eigen/Core>
#include <vector>

#include "fit/odometry.hpp"
#include "fit/wheel_time.hpp"

namespace fit::odometry_parts {

/// Robust standard deviation of each component: mm, mm, rad.
Eigen::Vector3d robust_noise(const std::vector<WheelSample>& samples, const RobotGeometry& robot);

/// Mean over the components, in units of the noise.
double squared_misfit(const WheelSample& sample, const RobotGeometry& robot, const Eigen::Vector3d& noise);

/// Offsets of the runs about a common one, each where its own wheels and matches agree best with this robot;
/// what a run does not determine by itself is left to the others (random effects, weighted by both
/// variances).
std::vector<double> offsets_of_runs(const TimedSamples& timed, const RobotGeometry& robot,
                                    const std::vector<double>& about_s);

/// Each run shifted by its own offset.
std::vector<WheelSample> shifted_by_run(const TimedSamples& timed, const std::vector<double>& offsets_s);

}  // namespace fit::odometry_parts
