// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <vector>

#include "fit/motion/motion_likelihood.hpp"
#include "fit/motion/odometry.hpp"
#include "fit/numeric/estimate.hpp"

namespace fit {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// Which group each sample belongs to: what happens within one (slip, a tyre that is pressed, a match's bias)
/// may be common to its samples; between groups it is not. Of six runs or more every run is one; of fewer,
/// each is cut into segments, so that there are twelve or more.
std::vector<std::size_t> group_samples(const std::vector<WheelSample>& samples);

/// The covariance from results that were each found without one group (delete-group jackknife, Wu 1986),
/// widened by Student's factor for so few groups, so that k = 2 covers 95 %.
Matrix6 jackknife(const std::vector<Vector6>& without);
/// What brings the standard uncertainty from so many groups to where k = 2 covers 95 %.
double student_widening(std::size_t groups);

/// Widens the fit's covariance where that of the groups is larger, parameter by parameter.
void widen_to(Matrix6& covariance, const Vector6& u);

/// How well a run, or a segment of one, agrees with the others.
struct RunVerdict {
  std::size_t run = 0, samples = 0;
  std::size_t segment = 0, segments = 1;  ///< Which of how many, if runs were cut.
  /// Distance of what it says of the robot from what the others say, in standard deviations, RMS over the
  /// directions that both determine.
  double misfit = 0;
  bool left_out = false;  ///< Slipped, or moved by hand: its misfit is beyond the scatter of the others.
};

/// Leaves out, one after the other, groups whose squared misfit is 17 times the median of the others'; at
/// most a third of them, and none of fewer than four. Returns one verdict for each group, `run` being its
/// index.
std::vector<RunVerdict> find_slipped(const std::vector<MotionEquations>& groups);

/// The same for samples by their `run`, each with noise of its own (matches of scans), at this robot.
std::vector<RunVerdict> find_slipped(const std::vector<WheelSample>& samples, const RobotGeometry& robot);

/// Time of the wheels minus time of the matches.
struct OffsetSearch {
  Estimate offset_s{0};
  bool determined = false;
  bool at_bound = false;  ///< The best offset lies at the end of the search: the true one may lie beyond.
  double searched_s = 0;  ///< Both ways.
  double misfit = 0;      ///< Geometric mean of the noises at the best offset: to compare clocks by.
};

struct OffsetOptions {
  double first_s = 2;   ///< Searched at first, both ways; never more than a quarter of the shortest run.
  double widest_s = 8;  ///< The search is widened up to this while the best lies at its end.
};

class TimedSamples;
/// Finds the offset at which wheels and matches agree best: on a coarse grid, widened while the best lies
/// near its end, then on a fine one with a parabola; uncertainty by leaving out one group after the other.
/// Only speeds that change tell it.
OffsetSearch find_offset(const TimedSamples& samples, const OdometryOptions& options,
                         const OffsetOptions& how = {});

struct RunsOptions {
  OdometryOptions fit;
  /// The samples' begin_s are measured: neighbours share a watched pose, and each run has an offset of its
  /// own.
  bool timed = false;
  std::optional<double> known_offset_s;  ///< Without it, estimated.
  OffsetOptions offset;
};

struct RunsFit {
  OdometryFit odometry;                 ///< Its covariance contains groups and offset.
  std::vector<WheelSample> samples;     ///< That `odometry` was made of.
  MotionNoise noise;                    ///< Of them.
  std::size_t groups = 0;               ///< Kept: runs, or their segments, as group_samples() makes them.
  Vector6 grouped_u = Vector6::Zero();  ///< By leaving out one group after the other.
  std::vector<RunVerdict> runs;         ///< Of all groups.
  OffsetSearch offset;                  ///< Common to all runs.
  std::vector<double> run_offsets_s;    ///< Taken for each run: recordings are started one by one.
  Vector6 offset_u = Vector6::Zero();   ///< Of the parameters, by the offset's uncertainty.
};

/// Calibrates a robot from samples of one or more runs. Beyond fit_odometry(): the clocks' offset is
/// estimated, of all and then of every run; where times are measured the likelihood has noise of poses and
/// noise that adds up on the way (MotionLikelihood), both estimated; groups that slipped are left out, and
/// the covariance is that of groups of samples. Throws std::invalid_argument for fewer than 20 samples.
RunsFit fit_runs(const std::vector<WheelSample>& samples, const RunsOptions& options = {});

}  // namespace fit
