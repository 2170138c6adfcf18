// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <vector>

#include "fit/estimate.hpp"
#include "fit/odometry.hpp"

namespace fit {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// Which group each sample belongs to: what happens within one (slip, a tyre that is pressed, a match's bias)
/// may be common to its samples; between groups it is not. Of six runs or more every run is one; of fewer,
/// each is cut into segments, so that there are twelve or more.
std::vector<std::size_t> group_samples(const std::vector<WheelSample>& samples);

/// Covariance of the fit by leaving out one group after the other (delete-group jackknife, Wu 1986), widened
/// by Student's factor for so few groups, so that k = 2 covers 95 %.
struct GroupedCovariance {
  Matrix6 covariance = Matrix6::Zero();
  std::vector<Vector6> without;  ///< The result without each group.
  std::size_t groups = 0;
};
GroupedCovariance grouped_covariance(const std::vector<WheelSample>& samples,
                                     const std::vector<std::size_t>& groups, const OdometryOptions& options);
/// The covariance from results that were each found without one group.
Matrix6 jackknife(const std::vector<Vector6>& without);
/// What brings the standard uncertainty from so many groups to where k = 2 covers 95 %.
double student_widening(std::size_t groups);

/// Widens the fit's covariance where that of the groups is larger, parameter by parameter.
void widen_to(Matrix6& covariance, const Vector6& u);

/// How well a run, or a segment of one, agrees with the others.
struct RunVerdict {
  std::size_t run = 0, samples = 0;
  std::size_t segment = 0, segments = 1;  ///< Which of how many, if runs were cut.
  double misfit = 0;                      ///< RMS of its residuals in units of the noise of the runs kept.
  bool left_out = false;  ///< Slipped, or moved by hand: its misfit is beyond the scatter of the others.
};

/// Leaves out, one after the other, runs whose residuals are larger than those of the other runs beyond
/// their scatter (4.5 robust standard deviations of the logarithm of their mean squares); at most a third of
/// them, and none of fewer than four. Returns the samples kept.
std::vector<WheelSample> leave_out_slipped_runs(const std::vector<WheelSample>& samples,
                                                const OdometryOptions& options,
                                                std::vector<RunVerdict>& verdicts);

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
  /// The samples' begin_s are measured: neighbours may be joined, and each run has an offset of its own.
  bool timed = false;
  std::optional<double> known_offset_s;  ///< Without it, estimated.
  OffsetOptions offset;
};

/// The fit to samples of one length.
struct LengthFit {
  std::size_t joined = 1;  ///< Neighbouring samples in one.
  std::size_t samples = 0;
  double interval_s = 0, way_mm = 0;  ///< Medians.
  Vector6 values = Vector6::Zero();
  Eigen::Vector3d noise = Eigen::Vector3d::Zero();  ///< Robust: mm, mm, rad.
  double worth = 0;    ///< What a second of driving tells, by the noise: relative.
  bool enough = true;  ///< Samples to be taken; else only the drift to this length is of use.
  bool taken = false;
};

struct RunsFit {
  OdometryFit odometry;              ///< Its covariance contains groups, offset and drift with length.
  std::vector<WheelSample> samples;  ///< That `odometry` was made of.
  GroupedCovariance grouped;
  std::vector<RunVerdict> runs;       ///< Or their segments, as group_samples() makes them.
  OffsetSearch offset;                ///< Common to all runs.
  std::vector<double> run_offsets_s;  ///< Taken for each run: recordings are started one by one.
  std::vector<LengthFit> lengths;
  Vector6 offset_u = Vector6::Zero();  ///< Of the parameters, by the offset's uncertainty.
  Vector6 drift = Vector6::Zero();     ///< From the length taken to twice that.
};

/// Calibrates a robot from samples of one or more runs. Beyond fit_odometry(): the clocks' offset is
/// estimated, of all and then of every run, neighbouring samples are joined to the length at which they tell
/// most (poses with noise of their own tell more from far apart, noise that adds up on the way does not),
/// groups that slipped are left out, and the covariance is that of groups of samples. Throws
/// std::invalid_argument for fewer than 20 samples.
RunsFit fit_runs(const std::vector<WheelSample>& samples, const RunsOptions& options = {});

}  // namespace fit
