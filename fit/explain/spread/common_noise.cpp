// SPDX-License-Identifier: MIT
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "fit/explain/spread/autoregression.hpp"
#include "fit/explain/spread/other_patterns.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/spread/unseen.hpp"

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
  const double most_deg = suspected(ids::angle_jitter).mechanism->parameters.front().largest;
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

/// What captures gain by the variances that the others show: by that of the angle beside that of the range,
/// and the other way round.
double unseen_gain_of_angle(const std::vector<Scan>& own, const std::vector<Scan>& others) {
  const auto [both, only_range, only_angle] = most_likely(others);
  return log_likelihood(own, both.range_mm2, both.angle_rad2) - log_likelihood(own, only_range.range_mm2, 0);
}
double unseen_gain_of_range(const std::vector<Scan>& own, const std::vector<Scan>& others) {
  const auto [both, only_range, only_angle] = most_likely(others);
  return log_likelihood(own, both.range_mm2, both.angle_rad2) - log_likelihood(own, 0, only_angle.angle_rad2);
}

/// Products of the common ranges of neighbouring scans, and their squares.
struct Neighbours {
  double products = 0, squares = 0, pairs = 0;

  void add(const Scan& one, const Scan& next) {
    const double a = next.range_score() / std::max(1e-9, next.range_information()),
                 b = one.range_score() / std::max(1e-9, one.range_information());
    products += a * b;
    squares += (a * a + b * b) / 2;
    pairs += 1;
  }
  void operator+=(const Neighbours& other) {
    products += other.products;
    squares += other.squares;
    pairs += other.pairs;
  }
  /// Their correlation. `scans` of a capture share its mean, from which they are counted.
  [[nodiscard]] double correlation(double scans) const {
    return squares > 0 ? products / squares + 1.5 / scans : 0;
  }
  /// What the log-likelihood of these gains if every scan is predicted by the one before, so correlated.
  [[nodiscard]] double gain(double correlated, double variance, double scans) const {
    return correlated * ((products + 1.5 / scans * squares) - correlated / 2 * squares) / variance;
  }
};

/// The memory of the common range.
class MemoryOfScans {
 public:
  explicit MemoryOfScans(const std::vector<Scan>& scans) : scans_(scans.front().scans) {
    for (std::size_t i = 1; i < scans.size(); ++i) {
      if (scans[i].group != scans[i - 1].group) continue;
      by_capture_[scans[i].capture].add(scans[i - 1], scans[i]);
      all_.add(scans[i - 1], scans[i]);
    }
  }
  /// Lag-one correlation.
  [[nodiscard]] double rho() const { return std::clamp(all_.correlation(scans_), 0.05, 0.98); }
  /// Whether captures show it that it was not learnt from.
  [[nodiscard]] bool is_seen_afresh() const {
    if (by_capture_.size() < 2) return false;
    std::set<int> captures;
    for (const auto& [capture, pairs] : by_capture_) captures.insert(capture);
    const int blocks = static_cast<int>(std::min<std::size_t>(4, captures.size()));
    const std::map<int, int> block = block_of_capture(captures, blocks);
    Unseen unseen;
    for (int b = 0; b < blocks; ++b) {
      Neighbours own, others;
      for (const auto& [capture, pairs] : by_capture_) (block.at(capture) == b ? own : others) += pairs;
      const double learnt = std::clamp(others.correlation(scans_), 0.0, 0.98);
      if (others.pairs > 0 && others.squares > 0)
        unseen.add(own.gain(learnt, (1 - learnt * learnt) * others.squares / others.pairs, scans_));
    }
    return unseen.gain() > 0;
  }
  /// Whether it would have been seen if there were one to speak of: `share` of the squares is common to a
  /// scan, the rest is the noise of beams.
  [[nodiscard]] bool is_excluded(double share) const {
    constexpr double to_speak_of = 0.3;
    return all_.correlation(scans_) + 2 / std::sqrt(std::max(1.0, all_.pairs)) < to_speak_of * share;
  }
  /// Of the squares of the ranges, mm^2.
  [[nodiscard]] double mean_square() const { return all_.squares / std::max(1.0, all_.pairs); }

 private:
  double scans_;
  std::map<int, Neighbours> by_capture_;
  Neighbours all_;
};

/// Scans that are long or short as a whole, and remember nothing.
Unexplained scans_at_random(const std::vector<Scan>& scans, const Suspect& suspect, double range_mm2) {
  Unexplained u;
  u.observable = Observable::range_variance;
  u.coordinate = Coordinate::scan_seq;
  u.gain = suspect.gain;
  u.evidence = suspect.evidence;
  for (const Scan& s : scans) u.to = std::max(u.to, static_cast<double>(s.seq));
  u.describes = "all ranges of a scan are long or short together, by " + rounded(std::sqrt(range_mm2), 2) +
                " mm at random, and no scan remembers the one before";
  return u;
}

}  // namespace

double evidence_of_common_noise(const std::vector<Scan>& scans) {
  const double gain = most_likely(scans).both.gain;
  return gain - 2 * price_of_size(gain);
}

void common_noise(const std::vector<Scan>& as_counted, const Reduced& reduced, SpreadResult& result) {
  if (as_counted.size() < 10) return;
  const std::vector<Group>& groups = reduced.groups;
  const std::vector<Scan> scans = by_noise_of_beams(as_counted, reduced);
  const MostLikely found = most_likely(scans);
  const double range_mm2 = found.both.range_mm2, angle_rad2 = found.both.angle_rad2;
  Suspect jitter = suspected(ids::angle_jitter);
  jitter.gain = found.gain_of_angle();
  jitter.evidence = jitter.gain - price_of_size(jitter.gain);
  if (angle_rad2 > 0 && jitter.evidence > accept_at) {
    jitter.held_out_gain = held_out_gain(scans, unseen_gain_of_angle, &Scan::capture);
    jitter.parameters = {{"sigma_deg", root_deg({angle_rad2, uncertainty_of_angle(scans, found.both)})}};
    result.accepted.push_back(jitter);
    result.noise.scan_angle_rad2 = angle_rad2;
    for (const Group& group : groups)
      result.noise.angle_rad2.push_back(angle_rad2 / std::max(1, group.scans));
  }
  Suspect wander = suspected(ids::correlated_noise);
  wander.gain = found.gain_of_range();
  wander.evidence = wander.gain - price_of_size(wander.gain);
  if (range_mm2 > 0 && wander.evidence > accept_at) {
    wander.held_out_gain = held_out_gain(scans, unseen_gain_of_range, &Scan::capture);
    const MemoryOfScans memory(as_counted);
    const double rho = memory.rho();
    double sigma2 = 0;
    for (const Group& group : groups) sigma2 = std::max(sigma2, group.sigma_mm * group.sigma_mm);
    wander.parameters = {{"rho", {rho, std::sqrt((1 - rho * rho) / static_cast<double>(scans.size()))}},
                         {"share", {std::min(1.0, range_mm2 / (sigma2 + 1e-9)), 0.1}}};
    // Noise with a memory only if that is seen; a range that every scan draws anew is another thing.
    if (memory.is_seen_afresh())
      result.accepted.push_back(wander);
    else if (memory.is_excluded(std::min(1.0, range_mm2 / memory.mean_square())))
      result.unknown.push_back(scans_at_random(scans, wander, range_mm2));
    else
      result.undecided.push_back({wander, Suspect{}});
    result.noise.scan_range_mm2 = range_mm2;
    for (const Group& group : groups)
      result.noise.range_mm2.push_back(range_mm2 * (1 + added_to_mean(group.scans, rho)) /
                                       std::max(1, group.scans));
  }
}

}  // namespace fit::explain::spread
