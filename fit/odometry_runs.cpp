// SPDX-License-Identifier: MIT
#include "fit/odometry_runs.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "fit/median.hpp"
#include "fit/number_format.hpp"
#include "fit/odometry_offset.hpp"
#include "fit/wheel_time.hpp"

namespace fit {

using odometry_parts::offsets_of_runs;
using odometry_parts::robust_noise;
using odometry_parts::shifted_by_run;
using odometry_parts::squared_misfit;

namespace {

const Steering& steering_in(const OdometryOptions& options) {
  return options.steering ? *options.steering : differential();
}

std::map<std::size_t, std::size_t> samples_of_runs(const std::vector<WheelSample>& samples) {
  std::map<std::size_t, std::size_t> count;
  for (const WheelSample& sample : samples) ++count[sample.run];
  return count;
}

/// Mean squared misfit of every run.
std::map<std::size_t, double> misfit_of_runs(const std::vector<WheelSample>& samples,
                                             const RobotGeometry& robot, const Eigen::Vector3d& noise) {
  std::map<std::size_t, double> sum;
  auto count = samples_of_runs(samples);
  for (const WheelSample& sample : samples) sum[sample.run] += squared_misfit(sample, robot, noise);
  for (auto& [run, value] : sum) value /= static_cast<double>(count[run]);
  return sum;
}

std::vector<WheelSample> without_run(const std::vector<WheelSample>& samples, std::size_t run) {
  std::vector<WheelSample> rest;
  for (const WheelSample& sample : samples)
    if (sample.run != run) rest.push_back(sample);
  return rest;
}

}  // namespace

std::vector<std::size_t> group_samples(const std::vector<WheelSample>& samples) {
  constexpr std::size_t enough_runs = 6, segments = 12;
  const auto runs = samples_of_runs(samples);
  const std::size_t each =
      runs.size() >= enough_runs ? 1 : (segments + runs.size() - 1) / std::max<std::size_t>(1, runs.size());
  std::map<std::size_t, std::size_t> first_group, seen;
  for (const auto& [run, count] : runs) first_group[run] = each * first_group.size();
  std::vector<std::size_t> groups;
  for (const WheelSample& sample : samples)
    groups.push_back(first_group[sample.run] + seen[sample.run]++ * each / runs.at(sample.run));
  return groups;
}

double student_widening(std::size_t groups) {
  return groups < 2 ? 1 : coverage_factor(static_cast<double>(groups - 1)) / 2;
}

Matrix6 jackknife(const std::vector<Vector6>& without) {
  const auto n = static_cast<double>(without.size());
  Matrix6 covariance = Matrix6::Zero();
  if (without.size() < 2) return covariance;
  Vector6 mean = Vector6::Zero();
  for (const Vector6& v : without) mean += v / n;
  for (const Vector6& v : without) {
    Vector6 d = v - mean;
    d[5] = wrap_angle(d[5]);
    covariance += d * d.transpose();
  }
  const double t = student_widening(without.size());
  return t * t * (n - 1) / n * covariance;
}

GroupedCovariance grouped_covariance(const std::vector<WheelSample>& samples,
                                     const std::vector<std::size_t>& groups, const OdometryOptions& options) {
  GroupedCovariance out;
  if (samples.empty()) return out;
  const std::size_t count = *std::ranges::max_element(groups) + 1;
  for (std::size_t group = 0; group < count; ++group) {
    std::vector<WheelSample> rest;
    for (std::size_t k = 0; k < samples.size(); ++k)
      if (groups[k] != group) rest.push_back(samples[k]);
    if (rest.size() == samples.size() || rest.size() < 20) continue;
    out.without.push_back(fit_odometry(rest, options).robot.vector());
  }
  out.groups = out.without.size();
  out.covariance = jackknife(out.without);
  return out;
}

void widen_to(Matrix6& covariance, const Vector6& u) {
  const Vector6 now = covariance.diagonal().cwiseSqrt();
  Vector6 factor;
  for (int i = 0; i < 6; ++i)
    factor[i] = now[i] > 0 && std::isfinite(u[i]) ? std::max(1.0, u[i] / now[i]) : 1;
  covariance = (factor.asDiagonal() * covariance * factor.asDiagonal()).eval();
}

std::vector<WheelSample> leave_out_slipped_runs(const std::vector<WheelSample>& samples,
                                                const OdometryOptions& options,
                                                std::vector<RunVerdict>& verdicts) {
  constexpr double beyond = 4.5;
  constexpr double least_scatter =
      0.4;  // Of the logarithm of mean squares: runs differ so much without slip.
  std::vector<WheelSample> kept = samples;
  const auto runs = samples_of_runs(samples);
  std::vector<std::size_t> out;
  RobotGeometry robot = fit_odometry(kept, options).robot;
  while (runs.size() >= 4 && out.size() < runs.size() / 3) {
    // The run that fits worst is judged by a fit without it: it has drawn the common one to itself.
    const auto misfits = misfit_of_runs(kept, robot, robust_noise(kept, robot));
    const auto worst = std::ranges::max_element(misfits, {}, [](const auto& m) { return m.second; })->first;
    auto rest = without_run(kept, worst);
    if (rest.size() < 20) break;
    const RobotGeometry other = fit_odometry(rest, options).robot;
    const Eigen::Vector3d noise = robust_noise(rest, other);
    std::vector<double> logs;
    for (const auto& [run, value] : misfit_of_runs(rest, other, noise)) logs.push_back(std::log(value));
    const double middle = median_of(logs);
    std::vector<double> off;
    for (const double value : logs) off.push_back(std::abs(value - middle));
    const double scatter = std::max(least_scatter, 1.4826 * median_of(off));
    const double its = std::log(misfit_of_runs(kept, other, noise).at(worst));
    if (its < middle + beyond * scatter) break;
    out.push_back(worst);
    kept = std::move(rest);
    robot = other;
  }
  verdicts.clear();
  for (const auto& [run, value] : misfit_of_runs(samples, robot, robust_noise(kept, robot)))
    verdicts.push_back({run, runs.at(run), 0, 1, std::sqrt(value), std::ranges::count(out, run) > 0});
  return kept;
}

// --- all together -----------------------------------------------------------------------------------------

namespace {

double median_way(const std::vector<WheelSample>& samples) {
  std::vector<double> ways;
  for (const WheelSample& sample : samples) ways.push_back(sample.match.position().norm());
  return median_of(ways);
}

double median_interval(const std::vector<WheelSample>& samples) {
  std::vector<double> all;
  for (const WheelSample& sample : samples) all.push_back(sample.interval_s);
  return median_of(all);
}

std::vector<WheelSample> at_length(const std::vector<WheelSample>& samples, std::size_t count) {
  return joined(samples, count, std::max<std::size_t>(1, count / 4));
}

/// The samples put together to the length at which a second of driving tells most.
std::vector<LengthFit> compare_lengths(const std::vector<WheelSample>& samples, const RunsOptions& options) {
  constexpr std::size_t least_samples = 24, least_apart = 12;
  bool enough = true;
  std::vector<LengthFit> lengths;
  const auto runs = samples_of_runs(samples);
  for (std::size_t count = 1;; count *= 2) {
    const auto some = count == 1 ? samples : at_length(samples, count);
    std::size_t apart = 0, whole = 0;  // Those that do not overlap, and those that are whole runs.
    for (const auto& [run, size] : runs)
      apart += std::max<std::size_t>(1, size / count), whole += size <= count;
    // One length more than can be taken shows the drift.
    if (!enough || some.size() < 20) break;
    enough =
        count == 1 || (some.size() >= least_samples && apart >= least_apart && whole <= runs.size() * 2 / 3);
    OdometryOptions how = options.fit;
    how.refine = how.refine || count > 1;
    const OdometryFit fit = fit_odometry(some, how);
    LengthFit length;
    length.joined = count, length.samples = some.size();
    length.interval_s = median_interval(some), length.way_mm = median_way(some);
    length.values = fit.robot.vector();
    length.noise = robust_noise(some, fit.robot);
    // Signals grow with the length, their number falls with it.
    for (int i = 0; i < 3; ++i)
      length.worth += std::log(length.interval_s / (length.noise[i] * length.noise[i])) / 3;
    length.enough = enough;
    lengths.push_back(length);
    if (!options.timed) break;
  }
  double most = -1e300;
  for (const LengthFit& length : lengths)
    if (length.enough) most = std::max(most, length.worth);
  for (LengthFit& length : lengths) length.worth = std::exp(length.worth - most);
  // Of those that tell about as much the shortest: it has most samples.
  std::ranges::find_if(lengths, [](const LengthFit& l) { return l.enough && l.worth > 0.9; })->taken = true;
  return lengths;
}

/// The time offset that is used; false where it is not determined, or does not differ from 0, and none was
/// given.
bool choose_offset(RunsFit& out, const TimedSamples& timed, const RunsOptions& options) {
  if (options.known_offset_s) {
    out.offset.offset_s = {*options.known_offset_s, 0};
    return true;
  }
  out.offset = find_offset(timed, options.fit, options.offset);
  const Estimate& offset = out.offset.offset_s;
  return out.offset.determined && std::abs(offset.value) > 2 * offset.u;
}

/// Groups take the place of the runs: slip is left out, and uncertainty counted, group by group. Returns the
/// groups that were left out.
std::vector<std::size_t> leave_out_slipped_groups(RunsFit& out, const OdometryOptions& how) {
  const auto groups = group_samples(out.samples);
  std::map<std::size_t, std::size_t> run_of, first_of;
  for (std::size_t k = 0; k < groups.size(); ++k) {
    run_of[groups[k]] = out.samples[k].run;
    const auto [first, is_new] = first_of.try_emplace(out.samples[k].run, groups[k]);
    if (!is_new) first->second = std::min(first->second, groups[k]);
    out.samples[k].run = groups[k];
  }
  out.samples = leave_out_slipped_runs(out.samples, how, out.runs);
  std::vector<std::size_t> left_out;
  for (RunVerdict& verdict : out.runs) {
    const std::size_t group = verdict.run;
    if (verdict.left_out) left_out.push_back(group);
    verdict.run = run_of.at(group);
    verdict.segment = group - first_of.at(verdict.run);
    verdict.segments = static_cast<std::size_t>(
        std::ranges::count_if(run_of, [&](const auto& entry) { return entry.second == verdict.run; }));
  }
  return left_out;
}

/// Change of the values for one standard uncertainty of the offset.
Vector6 offset_uncertainty(const RunsFit& out, const TimedSamples& timed, const OdometryOptions& how,
                           std::size_t count) {
  OdometryOptions quick = how;
  quick.rounds = 0;
  const auto values = [&](double by_s) {
    std::vector<double> offsets = out.run_offsets_s;
    for (double& offset : offsets) offset += by_s;
    const auto some = shifted_by_run(timed, offsets);
    return fit_odometry(count > 1 ? at_length(some, count) : some, quick).robot.vector();
  };
  const double u = out.offset.offset_s.u;
  return 0.5 * (values(u) - values(-u)).cwiseAbs();
}

/// Change of the values at twice the length, of the same runs or segments, with their own offsets.
Vector6 drift_at_twice(const RunsFit& out, const std::vector<WheelSample>& samples,
                       const OdometryOptions& how, std::size_t count,
                       const std::vector<std::size_t>& left_out) {
  Vector6 drift = Vector6::Zero();
  std::vector<WheelSample> twice = at_length(samples, 2 * count);
  const auto groups = group_samples(twice);
  for (std::size_t k = 0; k < twice.size(); ++k) twice[k].run = groups[k];
  std::erase_if(twice, [&](const WheelSample& sample) {
    return std::ranges::any_of(left_out, [&](std::size_t group) { return group == sample.run; });
  });
  if (twice.size() >= 20) drift = fit_odometry(twice, how).robot.vector() - out.odometry.robot.vector();
  drift[5] = wrap_angle(drift[5]);
  return drift;
}

}  // namespace

RunsFit fit_runs(const std::vector<WheelSample>& given, const RunsOptions& options) {
  if (given.size() < 20)
    throw std::invalid_argument("at least 20 samples are needed, not " + std::to_string(given.size()));
  RunsFit out;
  const TimedSamples timed(given, options.timed, steering_in(options.fit));
  const std::size_t runs =
      1 + std::ranges::max_element(given, {}, [](const WheelSample& s) { return s.run; })->run;
  const bool shifted = choose_offset(out, timed, options);
  std::vector<WheelSample> samples = shifted ? timed.shifted(out.offset.offset_s.value) : given;
  out.run_offsets_s.assign(runs, shifted ? out.offset.offset_s.value : 0);

  OdometryOptions how = options.fit;
  std::size_t count = 1;
  std::vector<std::size_t> left_out;  // Groups.
  for (int round = 0;; ++round) {
    if (round == 0) out.lengths = compare_lengths(samples, options);
    count = std::ranges::find_if(out.lengths, &LengthFit::taken)->joined;
    how.refine = options.fit.refine || count > 1;
    out.samples = count > 1 ? at_length(samples, count) : samples;
    left_out = leave_out_slipped_groups(out, how);
    out.odometry = fit_odometry(out.samples, how);
    if (round == 2 || !options.timed || options.known_offset_s || runs < 2) break;
    out.run_offsets_s = offsets_of_runs(timed, out.odometry.robot, out.run_offsets_s);
    samples = shifted_by_run(timed, out.run_offsets_s);
  }
  out.grouped = grouped_covariance(out.samples, group_samples(out.samples), how);
  if (shifted && !options.known_offset_s) out.offset_u = offset_uncertainty(out, timed, how, count);
  if (std::ranges::any_of(out.lengths, [&](const LengthFit& l) { return l.joined == 2 * count; }))
    out.drift = drift_at_twice(out, samples, how, count, left_out);
  // A drift counts as the half-width of what is equally likely.
  const Vector6 u =
      (out.grouped.covariance.diagonal() + out.offset_u.cwiseAbs2() + out.drift.cwiseAbs2() / 3).cwiseSqrt();
  widen_to(out.odometry.covariance, u);
  return out;
}

}  // namespace fit
