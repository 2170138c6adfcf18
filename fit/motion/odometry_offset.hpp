// SPDX-License-Identifier: MIT
#pragma once
// Time offsets of matched wheel samples. For fit/motion/odometry_runs.cpp and fit/motion/odometry_offset.cpp
// only.

#include <Eigen/Core>
#include <vector>

#include "fit/motion/odometry.hpp"
#include "fit/motion/wheel_time.hpp"

namespace fit::odometry_parts {

/// Offsets of the runs about a common one, each where its own wheels and matches agree best with this robot;
/// what a run does not determine by itself is left to the others (random effects, weighted by both
/// variances).
std::vector<double> offsets_of_runs(const TimedSamples& timed, const RobotGeometry& robot,
                                    const std::vector<double>& about_s);

/// Each run shifted by its own offset.
std::vector<WheelSample> shifted_by_run(const TimedSamples& timed, const std::vector<double>& offsets_s);

}  // namespace fit::odometry_parts
