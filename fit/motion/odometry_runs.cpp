// SPDX-License-Identifier: MIT
#include "fit/motion/odometry_runs.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <utility>

#include "fit/motion/odometry_offset.hpp"
#include "fit/motion/wheel_time.hpp"
#include "fit/numeric/dense.hpp"
#include "fit/numeric/median.hpp"
#include "fit/numeric/number_format.hpp"

namespace fit {

using odometry_parts::offsets_of_runs;
using odometry_parts::shifted_by_run;

namespace {

std::map<std::size_t, std::size_t> samples_of_runs(const std::vector<WheelSample>& samples) {
  std::map<std::size_t, std::size_t> count;
  for (const WheelSample& sample : samples) ++count[sample.run];
  return count;
}

}  // namespace

std::vector<std::size_t> group_samples(const std::vector<WheelSample>& samples) {
  constexpr std::size_t enough_runs = 6, segments = 12;
  const auto runs = samples_of_runs(samples);
  const std::size_t each =
      runs.size() >= enough_runs ? 1 : (segments + runs.size() - 1) / std::max<std::size_t>(1, runs.size());
  std::map<std::size_t, std::size_t> first_group, seen;
  std::size_t next = 0;
  for (const auto& [run, count] : runs) first_group[run] = std::exchange(next, next + std::min(each, count));
  std::vector<std::size_t> groups;
  for (const WheelSample& sample : samples) {
    const std::size_t count = runs.at(sample.run);
    groups.push_back(first_group[sample.run] + seen[sample.run]++ * std::min(each, count) / count);
  }
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

void widen_to(Matrix6& covariance, const Vector6& u) {
  const Vector6 now = covariance.diagonal().cwiseSqrt();
  Vector6 factor;
  for (int i = 0; i < 6; ++i)
    factor[i] = now[i] > 0 && std::isfinite(u[i]) ? std::max(1.0, u[i] / now[i]) : 1;
  covariance = (factor.asDiagonal() * covariance * factor.asDiagonal()).eval();
}

namespace {

/// Of the groups that no verdict leaves out.
MotionEquations sum_of(const std::vector<MotionEquations>& groups,
                       const std::vector<RunVerdict>& verdicts = {}) {
  MotionEquations sum;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (!verdicts.empty() && verdicts[g].left_out) continue;
    sum.samples += groups[g].samples;
    sum.information += groups[g].information;
    sum.gradient += groups[g].gradient;
  }
  return sum;
}

MotionEquations without(MotionEquations all, const MotionEquations& group) {
  all.samples -= group.samples;
  all.information -= group.information;
  all.gradient -= group.gradient;
  return all;
}

/// Twice what the best parameters of some equations gain in log-likelihood, and how many directions they
/// have. `unit`: of the parameters.
struct OwnGain {
  double chi2 = 0;
  int directions = 0;
};
OwnGain own_gain(const MotionEquations& equations, const Vector6& unit) {
  const auto eigen = dense::symmetric_eigen(unit.asDiagonal() * equations.information * unit.asDiagonal());
  OwnGain gain;
  for (int i = 0; i < 6; ++i) {
    if (eigen.values[i] < 1e-9 * eigen.values[5]) continue;
    const double along = eigen.vectors.col(i).dot(unit.cwiseProduct(equations.gradient));
    gain.chi2 += along * along / eigen.values[i];
    ++gain.directions;
  }
  return gain;
}

/// Of each group kept: how much worse it and the others are described by common parameters than each by its
/// own (a chi-square), for each direction that both determine.
std::vector<double> disagreements(const std::vector<MotionEquations>& groups,
                                  const std::vector<RunVerdict>& verdicts) {
  const MotionEquations all = sum_of(groups, verdicts);
  const Vector6 unit = all.information.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
  const OwnGain of_all = own_gain(all, unit);
  std::vector<double> out(groups.size(), 0.0);
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (verdicts[g].left_out) continue;
    const OwnGain its = own_gain(groups[g], unit), theirs = own_gain(without(all, groups[g]), unit);
    const int common = its.directions + theirs.directions - of_all.directions;
    out[g] = std::max(1e-6, its.chi2 + theirs.chi2 - of_all.chi2) / std::max(1, common);
  }
  return out;
}

}  // namespace

std::vector<RunVerdict> find_slipped(const std::vector<MotionEquations>& groups) {
  // The logarithm of a chi-square of six degrees of freedom has a standard deviation of 0.63; 4.5 of them.
  constexpr double beyond = 17;
  std::vector<RunVerdict> verdicts(groups.size());
  for (std::size_t g = 0; g < groups.size(); ++g)
    verdicts[g].run = g, verdicts[g].samples = groups[g].samples;
  for (std::size_t out = 0; groups.size() >= 4; ++out) {
    const auto now = disagreements(groups, verdicts);
    for (std::size_t g = 0; g < groups.size(); ++g)
      if (!verdicts[g].left_out) verdicts[g].misfit = std::sqrt(now[g]);
    if (out >= groups.size() / 3) break;
    // The group that fits worst is judged by the others without it: it has drawn the common parameters to
    // itself.
    const auto worst = static_cast<std::size_t>(std::ranges::max_element(now) - now.begin());
    verdicts[worst].left_out = true;
    const auto then = disagreements(groups, verdicts);
    std::vector<double> others;
    for (std::size_t g = 0; g < groups.size(); ++g)
      if (!verdicts[g].left_out) others.push_back(then[g]);
    if (now[worst] > beyond * median_of(others)) continue;
    verdicts[worst].left_out = false;
    break;
  }
  return verdicts;
}

std::vector<RunVerdict> find_slipped(const std::vector<WheelSample>& samples, const RobotGeometry& robot) {
  MotionLikelihood likelihood(samples, false);
  likelihood.linearise(robot);
  likelihood.estimate_noise();
  likelihood.estimate_noise();  // Outliers are judged by the noise that was found before.
  std::vector<std::size_t> runs;
  for (const WheelSample& sample : samples) runs.push_back(sample.run);
  return find_slipped(likelihood.equations(runs));
}

// --- all together -----------------------------------------------------------------------------------------

namespace {

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

Vector6 solution(const MotionEquations& equations, const RobotGeometry& robot) {
  return covariance_of_robot(equations.information, robot) * equations.gradient;
}

/// Fits `out.samples`; returns what each group says at the robot found.
std::vector<MotionEquations> fit_samples(RunsFit& out, const std::vector<std::size_t>& groups,
                                         const RunsOptions& options) {
  constexpr int passes = 4;
  out.odometry = fit_odometry(out.samples, options.fit);
  MotionLikelihood likelihood(out.samples, options.timed);
  likelihood.take_noise(out.noise);
  RobotGeometry& robot = out.odometry.robot;
  std::vector<MotionEquations> equations;
  for (int pass = 0; pass <= passes; ++pass) {
    if (pass == 0 || options.timed) likelihood.linearise(robot);
    likelihood.estimate_noise();
    equations = likelihood.equations(groups);
    if (!options.timed) continue;  // The robot stays; outliers are judged by the noise found before.
    const MotionEquations all = sum_of(equations);
    out.odometry.covariance = covariance_of_robot(all.information, robot);
    if (pass == passes) break;
    const Vector6 step = damped_step(all.information, all.gradient, robot);
    if (step.allFinite()) robot = RobotGeometry::from(robot.vector() + step, robot.steering);
  }
  out.noise = likelihood.noise();
  if (options.timed) {
    out.odometry.rounds.push_back({out.samples.size(), robot, residual_rms(out.samples, robot)});
    out.odometry.used.assign(out.samples.size(), true);
  }
  return equations;
}

/// Groups take the place of the runs: those that slipped are left out, and the fit is made again without.
std::vector<MotionEquations> fit_kept_groups(RunsFit& out, const RunsOptions& options) {
  const auto groups = group_samples(out.samples);
  auto equations = fit_samples(out, groups, options);
  out.runs = find_slipped(equations);
  std::map<std::size_t, std::size_t> segments;
  for (std::size_t k = 0, before = equations.size(); k < groups.size(); ++k) {
    if (groups[k] == before) continue;
    before = groups[k];
    out.runs[before].run = out.samples[k].run;
    out.runs[before].segment = segments[out.samples[k].run]++;
  }
  for (RunVerdict& verdict : out.runs) verdict.segments = segments[verdict.run];
  if (std::ranges::none_of(out.runs, &RunVerdict::left_out)) return equations;
  std::vector<WheelSample> kept;
  std::vector<std::size_t> of_kept;
  for (std::size_t k = 0; k < groups.size(); ++k)
    if (!out.runs[groups[k]].left_out) {
      kept.push_back(out.samples[k]);
      of_kept.push_back(groups[k]);
    }
  out.samples = std::move(kept);
  equations = fit_samples(out, of_kept, options);
  std::erase_if(equations, [](const MotionEquations& group) { return group.samples == 0; });
  return equations;
}

/// Change of the values for one standard uncertainty of the offset.
Vector6 offset_uncertainty(const RunsFit& out, const TimedSamples& timed, const RunsOptions& options) {
  const auto values = [&](double by_s) -> Vector6 {
    std::vector<double> offsets = out.run_offsets_s;
    for (double& offset : offsets) offset += by_s;
    const auto samples = shifted_by_run(timed, offsets);
    MotionLikelihood likelihood(samples, options.timed);
    likelihood.take_noise(out.noise);
    likelihood.linearise(out.odometry.robot);
    return solution(likelihood.equations(std::vector<std::size_t>(samples.size(), 0)).front(),
                    out.odometry.robot);
  };
  const double u = out.offset.offset_s.u;
  return 0.5 * (values(u) - values(-u)).cwiseAbs();
}

}  // namespace

RunsFit fit_runs(const std::vector<WheelSample>& given, const RunsOptions& options) {
  if (given.size() < 20)
    throw std::invalid_argument("at least 20 samples are needed, not " + std::to_string(given.size()));
  RunsFit out;
  const TimedSamples timed(given, options.timed, steering_of(options.fit.steering));
  const std::size_t runs =
      1 + std::ranges::max_element(given, {}, [](const WheelSample& s) { return s.run; })->run;
  const bool shifted = choose_offset(out, timed, options);
  out.run_offsets_s.assign(runs, shifted ? out.offset.offset_s.value : 0);
  out.samples = shifted ? timed.shifted(out.offset.offset_s.value) : given;
  std::vector<MotionEquations> groups;
  for (int round = 0;; ++round) {
    groups = fit_kept_groups(out, options);
    if (round == 2 || !options.timed || options.known_offset_s || runs < 2) break;
    out.run_offsets_s = offsets_of_runs(timed, out.odometry.robot, out.run_offsets_s);
    out.samples = shifted_by_run(timed, out.run_offsets_s);
  }
  // One step from the common robot leads to that of all groups but one.
  out.groups = groups.size();
  const MotionEquations all = sum_of(groups);
  std::vector<Vector6> steps;
  for (const MotionEquations& group : groups)
    steps.emplace_back(solution(without(all, group), out.odometry.robot));
  out.grouped_u = jackknife(steps).diagonal().cwiseSqrt();
  if (shifted && !options.known_offset_s) out.offset_u = offset_uncertainty(out, timed, options);
  widen_to(out.odometry.covariance, (out.grouped_u.cwiseAbs2() + out.offset_u.cwiseAbs2()).cwiseSqrt());
  if (options.timed) judge_determined(out.odometry, false);
  return out;
}

}  // namespace fit
