// SPDX-License-Identifier: MIT
#pragma once
// Values, tables and notes of the result `odometry`.

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fit/motion/drive.hpp"
#include "fit/motion/odometry.hpp"
#include "fit/motion/odometry_runs.hpp"

namespace rig::odometry_parts {

using Parameters = std::array<fit::Steering::Parameter, 6>;

Parameters parameters_of(const fit::Steering& steering);
const fit::Steering& steering_of(const fit::RobotGeometry& robot);
nlohmann::json values_of(const fit::OdometryFit& fit);
nlohmann::json covariance_of(const Eigen::Matrix<double, 6, 6>& covariance, const Parameters& parameters);
nlohmann::json rounds_table(const fit::OdometryFit& fit);
nlohmann::json motion_table(const fit::MotionShares& motion);
nlohmann::json residual_plot(const fit::OdometryFit& fit, const std::vector<fit::WheelSample>& samples);
/// `theirs`: what others found or the maker says, with standard uncertainties where known.
nlohmann::json comparison(const std::string& title, const char* whose, const fit::OdometryFit& fit,
                          const std::optional<double> (&theirs)[6],
                          const std::optional<double> (&their_u)[6]);
/// X_results.json beside X.tuple, as the public programs of Censi et al. write it.
std::optional<nlohmann::json> published_table(const std::string& path, const fit::OdometryFit& fit);
nlohmann::json drive_table(const fit::DriveFit& drive);
nlohmann::json drive_lengths_table(const fit::DriveFit& drive);
nlohmann::json convergence_table(const fit::DriveFit& drive);
nlohmann::json uncertainty_table(const fit::DriveFit& drive, double range_scale);
void say_offset(nlohmann::json& out, const fit::OffsetSearch& offset, const std::optional<double>& known_s);
void say_slipped_runs(nlohmann::json& out, const std::vector<fit::RunVerdict>& runs,
                      const std::vector<std::string>& names);
nlohmann::json runs_table(const fit::RunsFit& fit, const std::vector<std::string>& names);
nlohmann::json tuple_uncertainty_table(const fit::RunsFit& fit);
nlohmann::json segments_table(const fit::DriveFit& drive);
nlohmann::json noise_table(const fit::RunsFit& fit);

}  // namespace rig::odometry_parts
