// SPDX-License-Identifier: MIT
#include "fit/odometry_runs.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "fit/median.hpp"
#include "fit/number_format.hpp"
#include "fit/wheel_time.hpp"

namespace fit {
namespace {

const Steering& steering_in(const OdometryOptions& options) {
  return options.steering ? *options.steering : differential();
}

std::map<std::size_t, std::size_t> samples_of_runs(const std::vector<WheelSample>& samples) {
  std::map<std::size_t, std::size_t> count;
  for (const WheelSample& sample : samples) ++count[sample.run];
  return count;
}

/// Robust standard deviation of each component.
Eigen::Vector3d robust_noise(const std::vector<WheelSample>& samples, const RobotGeometry& robot) {
  Eigen::Vector3d noise;
  for (int i = 0; i < 3; ++i) {
    std::vector<double> squares;
    for (const WheelSample& sample : samples) {
      const Eigen::Vector3d e = odometry_residual(robot, sample);
      squares.push_back(e[i] * e[i]);
    }
    noise[i] = std::sqrt(std::max(1e-18, median_of(squares) / median_of_normal_squares));
  }
  return noise;
}

double squared_misfit(const WheelSample& sample, const RobotGeometry& robot, const Eigen::Vector3d& noise) {
  return odometry_residual(robot, sample).cwiseQuotient(noise).squaredNorm() / 3;
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
  for (int i = 0; i < 6; ++i) factor[i] = now[i] > 0 && std::isfinite(u[i]) ? std::max(1.0, u[i] / now[i]) : 1;
  covariance = (factor.asDiagonal() * covariance * factor.asDiagonal()).eval();
}

std::vector<WheelSample> leave_out_slipped_runs(const std::vector<WheelSample>& samples,
                                                const OdometryOptions& options,
                                                std::vector<RunVerdict>& verdicts) {
  constexpr double beyond = 4.5;
  constexpr double least_scatter = 0.4;  // Of the logarithm of mean squares: runs differ so much without slip.
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

// --- time offset ------------------------------------------------------------------------------------------

namespace {

/// Some of the samples: enough to see an offset by.
std::vector<std::size_t> thinned(std::size_t count) {
  constexpr std::size_t enough = 2000;
  std::vector<std::size_t> out;
  const std::size_t stride = 1 + count / enough;
  for (std::size_t i = 0; i < count; i += stride) out.push_back(i);
  return out;
}

/// The disagreement of wheels and matches at some offsets.
class OffsetCurve {
 public:
  OffsetCurve(const TimedSamples& samples, const OdometryOptions& options, double widest_s)
      : timed_(samples), options_(options) {
    options_.rounds = 0;
    options_.refine = false;
    // The same samples at every offset, so that sums can be compared.
    const auto groups = group_samples(samples.samples());
    for (const std::size_t i : thinned(samples.samples().size()))
      if (samples.covers(i, widest_s) && samples.covers(i, -widest_s)) {
        some_.push_back(i);
        group_.push_back(groups[i]);
        groups_ = std::max(groups_, groups[i] + 1);
      }
    if (usable()) noise_ = robust_noise(at(0), fit_odometry(at(0), options_).robot);
  }
  [[nodiscard]] bool usable() const { return some_.size() >= 40; }

  /// Takes the noise at an offset as the unit.
  void take_noise(double offset_s) {
    const auto samples = at(offset_s);
    noise_ = robust_noise(samples, fit_odometry(samples, options_).robot);
  }
  [[nodiscard]] double noise() const { return std::cbrt(noise_.prod()); }

  /// Sum of the misfits of each group, each sample's bounded.
  [[nodiscard]] std::vector<double> by_group(double offset_s) const {
    const auto samples = at(offset_s);
    const RobotGeometry robot = fit_odometry(samples, options_).robot;
    std::vector<double> sum(groups_, 0.0);
    for (std::size_t k = 0; k < samples.size(); ++k)
      sum[group_[k]] += std::min(16.0, 3 * squared_misfit(samples[k], robot, noise_));
    return sum;
  }

 private:
  [[nodiscard]] std::vector<WheelSample> at(double offset_s) const {
    std::vector<WheelSample> out;
    for (const std::size_t i : some_) out.push_back(timed_.shifted(i, offset_s));
    return out;
  }
  const TimedSamples& timed_;
  OdometryOptions options_;
  std::vector<std::size_t> some_, group_;
  std::size_t groups_ = 0;
  Eigen::Vector3d noise_ = Eigen::Vector3d::Ones();
};

using Costs = std::vector<std::vector<double>>;  ///< One row an offset, one column a group.

double total(const std::vector<double>& row, std::size_t without) {
  double sum = 0;
  for (std::size_t g = 0; g < row.size(); ++g)
    if (g != without) sum += row[g];
  return sum;
}

/// Place of the least total on an even grid, by the parabola through its neighbours.
double least_at(const std::vector<double>& grid, const Costs& costs, std::size_t without) {
  std::size_t best = 0;
  for (std::size_t i = 0; i < grid.size(); ++i)
    if (total(costs[i], without) < total(costs[best], without)) best = i;
  if (best == 0 || best + 1 >= grid.size()) return grid[best];
  const double a = total(costs[best - 1], without), b = total(costs[best], without),
               c = total(costs[best + 1], without);
  const double bend = a - 2 * b + c;
  if (!(bend > 0)) return grid[best];
  const double step = grid[best + 1] - grid[best];
  return grid[best] + std::clamp(0.5 * step * (a - c) / bend, -step, step);
}

std::vector<double> even(double centre, double half, int steps) {
  std::vector<double> grid;
  for (int k = -steps; k <= steps; ++k) grid.push_back(centre + half * k / steps);
  return grid;
}

}  // namespace

OffsetSearch find_offset(const TimedSamples& samples, const OdometryOptions& options,
                         const OffsetOptions& how) {
  OffsetSearch out;
  if (samples.samples().size() < 40) return out;
  const std::size_t nobody = static_cast<std::size_t>(-1);
  const double bound = std::min(how.widest_s, 0.25 * samples.shortest_run_s());
  double widest = std::min(how.first_s, bound);
  for (;;) {
    OffsetCurve curve(samples, options, widest);
    out.searched_s = widest;
    if (!curve.usable()) return out;
    const auto costs_on = [&](const std::vector<double>& grid) {
      Costs costs;
      for (const double offset : grid) costs.push_back(curve.by_group(offset));
      return costs;
    };
    const auto coarse = even(0, widest, std::clamp(static_cast<int>(std::lround(widest / 0.05)), 10, 80));
    // Far from the true offset the noise is not that of the matches: once more with that of the best.
    double best = least_at(coarse, costs_on(coarse), nobody);
    curve.take_noise(best);
    out.misfit = curve.noise();
    const Costs costs = costs_on(coarse);
    best = least_at(coarse, costs, nobody);
    if (std::abs(best) > 0.9 * widest) {
      if (widest < bound * (1 - 1e-9)) {
        widest = std::min(2 * widest, bound);
        continue;
      }
      out.offset_s = {best, 0};
      out.at_bound = true;
      return out;
    }
    const auto fine = even(best, 2 * (coarse[1] - coarse[0]), 16);
    const Costs fine_costs = costs_on(fine);
    const double found = least_at(fine, fine_costs, nobody);
    // Groups that disagree by more than the fine grid are seen on the coarse one.
    double squares = 0, sum = 0;
    const std::size_t groups = fine_costs.front().size();
    std::vector<double> without;
    for (std::size_t g = 0; g < groups; ++g) {
      const double rough = least_at(coarse, costs, g);
      const bool near = rough >= fine.front() && rough <= fine.back();
      without.push_back(near ? least_at(fine, fine_costs, g) : rough);
    }
    for (const double value : without) sum += value / static_cast<double>(groups);
    for (const double value : without) squares += (value - sum) * (value - sum);
    const auto n = static_cast<double>(groups);
    // A curve that hardly bends against the scatter of the misfits tells nothing, whatever its least place.
    double bend = 0;
    const std::size_t middle = fine.size() / 2;
    const double step = fine[1] - fine[0];
    bend = (total(fine_costs.back(), nobody) - 2 * total(fine_costs[middle], nobody) +
            total(fine_costs.front(), nobody)) /
           std::pow(step * static_cast<double>(middle), 2);
    const double by_bend = bend > 0 ? std::sqrt(2 / bend) : widest;
    out.offset_s = {found, std::max(by_bend, student_widening(groups) * std::sqrt((n - 1) / n * squares))};
    out.determined = out.offset_s.u < 0.25 * widest;
    return out;
  }
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
    for (const auto& [run, size] : runs) apart += std::max<std::size_t>(1, size / count), whole += size <= count;
    // One length more than can be taken shows the drift.
    if (!enough || some.size() < 20) break;
    enough = count == 1 ||
             (some.size() >= least_samples && apart >= least_apart && whole <= runs.size() * 2 / 3);
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

/// Offsets of the runs about a common one, each where its own wheels and matches agree best with this robot; what
/// a run does not tell by itself is left to the others (random effects, weighted by both variances).
std::vector<double> offsets_of_runs(const TimedSamples& timed, const RobotGeometry& robot,
                                    const std::vector<double>& about_s) {
  constexpr double reach_s = 0.3;
  constexpr int steps = 15;
  const auto& samples = timed.samples();
  std::vector<std::vector<std::size_t>> of_run(about_s.size());
  for (std::size_t i = 0; i < samples.size(); ++i) of_run[samples[i].run].push_back(i);
  std::vector<WheelSample> all;
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (timed.covers(i, about_s[samples[i].run])) all.push_back(timed.shifted(i, about_s[samples[i].run]));
  const Eigen::Vector3d noise = robust_noise(all, robot);
  std::vector<double> found = about_s, variance(about_s.size(), 1e18);
  for (std::size_t run = 0; run < about_s.size(); ++run) {
    std::vector<std::size_t> some;
    for (const std::size_t i : of_run[run])
      if (timed.covers(i, about_s[run] - reach_s) && timed.covers(i, about_s[run] + reach_s)) some.push_back(i);
    if (some.size() < 20) continue;
    const auto grid = even(about_s[run], reach_s, steps);
    Costs costs;
    for (const double offset : grid) {
      double sum = 0;
      for (const std::size_t i : some)
        sum += std::min(16.0, 3 * squared_misfit(timed.shifted(i, offset), robot, noise));
      costs.push_back({sum});
    }
    const auto best = static_cast<std::size_t>(std::ranges::min_element(costs) - costs.begin());
    if (best < 2 || best + 2 >= grid.size()) continue;
    const double bend = (costs[best - 2][0] - 2 * costs[best][0] + costs[best + 2][0]) / std::pow(grid[2] - grid[0], 2);
    if (!(bend > 0)) continue;
    found[run] = least_at(grid, costs, static_cast<std::size_t>(-1));
    variance[run] = 2 / bend;
  }
  double w = 0, mean = 0, between = 0, n = 0;
  for (std::size_t r = 0; r < found.size(); ++r) w += 1 / variance[r], mean += found[r] / variance[r];
  mean /= w;
  for (std::size_t r = 0; r < found.size(); ++r)
    if (variance[r] < 1e17) between += std::pow(found[r] - mean, 2) - variance[r], n += 1;
  between = n > 1 ? std::max(0.0, between / (n - 1)) : 0;
  for (std::size_t r = 0; r < found.size(); ++r)
    found[r] = (found[r] * between + mean * variance[r]) / (between + variance[r]);
  return found;
}

/// Each run shifted by its own offset.
std::vector<WheelSample> shifted_by_run(const TimedSamples& timed, const std::vector<double>& offsets_s) {
  std::vector<WheelSample> out;
  for (std::size_t i = 0; i < timed.samples().size(); ++i) {
    const double offset = offsets_s[timed.samples()[i].run];
    if (timed.covers(i, offset)) out.push_back(timed.shifted(i, offset));
  }
  return out;
}

}  // namespace

RunsFit fit_runs(const std::vector<WheelSample>& given, const RunsOptions& options) {
  if (given.size() < 20)
    throw std::invalid_argument("at least 20 samples are needed, not " + std::to_string(given.size()));
  RunsFit out;
  const TimedSamples timed(given, options.timed, steering_in(options.fit));
  const std::size_t runs =
      1 + std::ranges::max_element(given, {}, [](const WheelSample& s) { return s.run; })->run;
  std::vector<WheelSample> samples = given;
  bool used_offset = false;
  if (options.known_offset_s) {
    out.offset.offset_s = {*options.known_offset_s, 0};
    samples = timed.shifted(*options.known_offset_s);
  } else {
    out.offset = find_offset(timed, options.fit, options.offset);
    const Estimate& offset = out.offset.offset_s;
    used_offset = out.offset.determined && std::abs(offset.value) > 2 * offset.u;
    if (used_offset) samples = timed.shifted(offset.value);
  }
  out.run_offsets_s.assign(runs, used_offset || options.known_offset_s ? out.offset.offset_s.value : 0);

  OdometryOptions how = options.fit;
  std::size_t count = 1;
  std::vector<std::size_t> left_out;  // Groups.
  for (int round = 0;; ++round) {
    if (round == 0) out.lengths = compare_lengths(samples, options);
    count = std::ranges::find_if(out.lengths, &LengthFit::taken)->joined;
    how.refine = options.fit.refine || count > 1;
    out.samples = count > 1 ? at_length(samples, count) : samples;
    // Groups take the place of the runs: slip is left out, and uncertainty counted, group by group.
    const auto groups = group_samples(out.samples);
    std::map<std::size_t, std::size_t> run_of, first_of;
    for (std::size_t k = 0; k < groups.size(); ++k) {
      run_of[groups[k]] = out.samples[k].run;
      const auto [first, is_new] = first_of.try_emplace(out.samples[k].run, groups[k]);
      if (!is_new) first->second = std::min(first->second, groups[k]);
      out.samples[k].run = groups[k];
    }
    out.samples = leave_out_slipped_runs(out.samples, how, out.runs);
    left_out.clear();
    for (RunVerdict& verdict : out.runs) {
      const std::size_t group = verdict.run;
      if (verdict.left_out) left_out.push_back(group);
      verdict.run = run_of.at(group);
      verdict.segment = group - first_of.at(verdict.run);
      verdict.segments = static_cast<std::size_t>(
          std::ranges::count_if(run_of, [&](const auto& entry) { return entry.second == verdict.run; }));
    }
    out.odometry = fit_odometry(out.samples, how);
    if (round == 2 || !options.timed || options.known_offset_s || runs < 2) break;
    out.run_offsets_s = offsets_of_runs(timed, out.odometry.robot, out.run_offsets_s);
    samples = shifted_by_run(timed, out.run_offsets_s);
  }
  out.grouped = grouped_covariance(out.samples, group_samples(out.samples), how);

  if (used_offset) {
    const double u = out.offset.offset_s.u;
    OdometryOptions quick = how;
    quick.rounds = 0;
    const auto values = [&](double by_s) {
      std::vector<double> offsets = out.run_offsets_s;
      for (double& offset : offsets) offset += by_s;
      const auto some = shifted_by_run(timed, offsets);
      return fit_odometry(count > 1 ? at_length(some, count) : some, quick).robot.vector();
    };
    out.offset_u = 0.5 * (values(u) - values(-u)).cwiseAbs();
  }
  if (std::ranges::any_of(out.lengths, [&](const LengthFit& l) { return l.joined == 2 * count; })) {
    // Of the same runs or segments, with their own offsets.
    std::vector<WheelSample> twice = at_length(samples, 2 * count);
    const auto groups = group_samples(twice);
    for (std::size_t k = 0; k < twice.size(); ++k) twice[k].run = groups[k];
    std::erase_if(twice, [&](const WheelSample& sample) {
      return std::ranges::any_of(left_out, [&](std::size_t group) { return group == sample.run; });
    });
    if (twice.size() >= 20) out.drift = fit_odometry(twice, how).robot.vector() - out.odometry.robot.vector();
    out.drift[5] = wrap_angle(out.drift[5]);
  }
  // A drift counts as the half-width of what is equally likely.
  const Vector6 u =
      (out.grouped.covariance.diagonal() + out.offset_u.cwiseAbs2() + out.drift.cwiseAbs2() / 3).cwiseSqrt();
  widen_to(out.odometry.covariance, u);
  return out;
}

}  // namespace fit
