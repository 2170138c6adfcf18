// SPDX-License-Identifier: MIT
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "fit/explain/spread/autoregression.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {
namespace {

double log_likelihood(const std::vector<Scan>& scans, double range_mm2, double angle_rad2) {
  double sum = 0;
  for (const Scan& s : scans) {
    if (s.scans < 2) continue;
    // Scans are counted from their capture's mean: of n scans, n - 1 are news, noise and all.
    const double news = 1 - 1.0 / s.scans;
    const Eigen::Matrix2d d = Eigen::Vector2d(range_mm2, angle_rad2).asDiagonal();
    const Eigen::Matrix2d m = Eigen::Matrix2d::Identity() + d * s.information;
    sum += 0.5 * s.score.dot(m.inverse() * d * s.score) -
           0.5 * news * std::log(std::max(1e-300, m.determinant()));
  }
  return sum;
}

/// Variances of the range and the angle that the samples of a scan have in common.
struct Variances {
  double range_mm2 = 0, angle_rad2 = 0;
  double gain = 0;  ///< Of the log-likelihood.
};

/// The most likely ones: of both, and of one alone.
struct MostLikely {
  Variances both, only_range, only_angle;

  [[nodiscard]] double gain_of_range() const { return both.gain - only_angle.gain; }
  [[nodiscard]] double gain_of_angle() const { return both.gain - only_range.gain; }
};

/// Profiles on logarithmic grids, finer in each pass.
MostLikely most_likely(const std::vector<Scan>& scans) {
  const auto improve = [&](Variances& best, double range_mm2, double angle_rad2) {
    const double gain = log_likelihood(scans, range_mm2, angle_rad2);
    if (gain > best.gain) best = {range_mm2, angle_rad2, gain};
  };
  MostLikely found;
  auto& [best, only_range, only_angle] = found;
  for (double r = 0.003; r < 20; r *= 1.5) improve(only_range, r * r, 0);
  const double most_deg = suspected("angle-jitter").mechanism->parameters.front().largest;
  for (double a = 0.001; a < 2 * most_deg; a *= 1.5) improve(only_angle, 0, std::pow(a * rad_per_deg, 2));
  improve(best, only_range.range_mm2, 0);
  improve(best, 0, only_angle.angle_rad2);
  improve(best, only_range.range_mm2, only_angle.angle_rad2);
  double step = 1.4;
  for (int pass = 0; pass < 20 && best.gain > 0; ++pass) {
    const double r = best.range_mm2, a = best.angle_rad2;
    for (const double f : {step, 1 / step}) improve(best, r * f, a);
    for (const double f : {step, 1 / step}) improve(best, best.range_mm2, a * f);
    improve(best, 0, best.angle_rad2);
    improve(best, best.range_mm2, 0);
    if (r == best.range_mm2 && a == best.angle_rad2) step = std::sqrt(step);
  }
  // No mirror is so loose: something else scatters.
  if (best.angle_rad2 > std::pow(most_deg * rad_per_deg, 2)) {
    best = only_range;
    only_angle = {};
  }
  return found;
}

/// Of the angle's variance, from the curvature of the log-likelihood.
double uncertainty_of_angle(const std::vector<Scan>& scans, const Variances& best) {
  const double at = best.angle_rad2, h = 0.1 * at;
  const auto l = [&](double angle_rad2) { return log_likelihood(scans, best.range_mm2, angle_rad2); };
  const double c = -(l(at + h) - 2 * l(at) + l(at - h)) / (h * h);
  return c > 0 ? 1 / std::sqrt(c) : at;
}

/// The memory of the common range: lag-one correlation of its estimates.
double memory_of_range(const std::vector<Scan>& scans) {
  double products = 0, squares = 0;
  for (std::size_t i = 1; i < scans.size(); ++i) {
    if (scans[i].group != scans[i - 1].group) continue;
    const double a = scans[i].range_score() / std::max(1e-9, scans[i].range_information()),
                 b = scans[i - 1].range_score() / std::max(1e-9, scans[i - 1].range_information());
    products += a * b;
    squares += (a * a + b * b) / 2;
  }
  const double n = scans.front().scans;
  return std::clamp(squares > 0 ? products / squares + 1.5 / n : 0.0, 0.05, 0.98);
}

}  // namespace

void common_noise(const std::vector<Scan>& scans, const std::vector<Group>& groups, SpreadResult& result) {
  if (scans.size() < 10) return;
  const MostLikely found = most_likely(scans);
  const double range_mm2 = found.both.range_mm2, angle_rad2 = found.both.angle_rad2;
  Suspect jitter = suspected("angle-jitter");
  jitter.gain = found.gain_of_angle();
  jitter.evidence = jitter.gain - price_of_size(jitter.gain);
  if (angle_rad2 > 0 && jitter.evidence > accept_at) {
    jitter.parameters = {{"sigma_deg", root_deg({angle_rad2, uncertainty_of_angle(scans, found.both)})}};
    result.accepted.push_back(jitter);
    result.noise.scan_angle_rad2 = angle_rad2;
    for (const Group& group : groups)
      result.noise.angle_rad2.push_back(angle_rad2 / std::max(1, group.scans));
  }
  Suspect wander = suspected("correlated-noise");
  wander.gain = found.gain_of_range();
  wander.evidence = wander.gain - price_of_size(wander.gain);
  if (range_mm2 > 0 && wander.evidence > accept_at) {
    const double rho = memory_of_range(scans);
    double sigma2 = 0;
    for (const Group& group : groups) sigma2 = std::max(sigma2, group.sigma_mm * group.sigma_mm);
    wander.parameters = {{"rho", {rho, std::sqrt((1 - rho * rho) / static_cast<double>(scans.size()))}},
                         {"share", {std::min(1.0, range_mm2 / (sigma2 + 1e-9)), 0.1}}};
    result.accepted.push_back(wander);
    result.noise.scan_range_mm2 = range_mm2;
    for (const Group& group : groups)
      result.noise.range_mm2.push_back(range_mm2 * (1 + added_to_mean(group.scans, rho)) /
                                       std::max(1, group.scans));
  }
}

}  // namespace fit::explain::spread
