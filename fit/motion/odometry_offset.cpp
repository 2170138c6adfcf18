// SPDX-License-Identifier: MIT
// Noise and time offsets of matched wheel samples.
#include "fit/motion/odometry_offset.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "fit/motion/odometry_runs.hpp"
#include "fit/numeric/median.hpp"

namespace fit {
namespace {

/// Robust standard deviation of each component: mm, mm, rad.
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

/// Mean over the components, in units of the noise.
double squared_misfit(const WheelSample& sample, const RobotGeometry& robot, const Eigen::Vector3d& noise) {
  return odometry_residual(robot, sample).cwiseQuotient(noise).squaredNorm() / 3;
}

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

namespace odometry_parts {

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
      if (timed.covers(i, about_s[run] - reach_s) && timed.covers(i, about_s[run] + reach_s))
        some.push_back(i);
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
    const double bend =
        (costs[best - 2][0] - 2 * costs[best][0] + costs[best + 2][0]) / std::pow(grid[2] - grid[0], 2);
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

std::vector<WheelSample> shifted_by_run(const TimedSamples& timed, const std::vector<double>& offsets_s) {
  std::vector<WheelSample> out;
  for (std::size_t i = 0; i < timed.samples().size(); ++i) {
    const double offset = offsets_s[timed.samples()[i].run];
    if (timed.covers(i, offset)) out.push_back(timed.shifted(i, offset));
  }
  return out;
}

}  // namespace odometry_parts
}  // namespace fit
