// SPDX-License-Identifier: MIT
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "fit/explain/spread/autoregression.hpp"
#include "fit/explain/spread/other_patterns.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/spread/unseen.hpp"

namespace fit::explain::spread {
namespace {

/// The white noise of a beam and noise with memory.
struct Mixture {
  double rho = 0, share = 0;  ///< Of the noise with memory, of the whole variance.
};

/// What groups of n scans show together.
struct Lagged {
  int n;
  LagSums pairs = pairs_of(n), white = lagged_of(n, 0);
  LagSums sums{};      ///< Of products, in units of the variance.
  double squares = 0;  ///< Of products of neighbours, in units of the variance's square.
  double cells = 0;

  explicit Lagged(int scans) : n(scans) {}

  /// Of the sums, of one cell whose variance is one.
  [[nodiscard]] LagSums expected(const Mixture& noise) const {
    LagSums mixed = lagged_of(n, noise.rho);
    for (std::size_t band = 0; band < lag_bands.size(); ++band)
      mixed[band] = noise.share * mixed[band] + (1 - noise.share) * white[band];
    return mixed;
  }
  /// Variance of one product in units of that of normal samples of equal variance: beams that differ in
  /// noise, and samples that are not normal, make products scatter more.
  [[nodiscard]] double each_product() const { return std::max(1.0, squares / (cells * pairs[1])); }
};
using ByLength = std::map<int, Lagged>;

constexpr double least_rho = 0.05, most_rho = 0.99, least_share = 0.001;

bool tells_of_memory(const Group& group) { return group.scans >= 4 && group.cells > 0; }

ByLength lagged_by_length(const std::vector<Group>& groups) {
  ByLength by_length;
  for (const Group& group : groups) {
    if (!tells_of_memory(group)) continue;
    Lagged& lagged = by_length.try_emplace(group.scans, group.scans).first->second;
    const double scale = group.lagged[0] / (group.scans - 1.0) / static_cast<double>(group.cells);
    if (scale <= 0) continue;
    for (std::size_t band = 0; band < lag_bands.size(); ++band)
      lagged.sums[band] += group.lagged[band] / scale;
    lagged.squares += group.lagged_squares / (scale * scale);
    lagged.cells += static_cast<double>(group.cells);
  }
  return by_length;
}

/// Deviations of the sums from what is expected, in units of their standard deviations without memory.
Eigen::VectorXd deviations(const ByLength& by_length, const Mixture& noise) {
  Eigen::VectorXd list(static_cast<Eigen::Index>(by_length.size() * (lag_bands.size() - 1)));
  list.setZero();
  Eigen::Index at = 0;
  for (const auto& [n, lagged] : by_length) {
    const LagSums expected = lagged.expected(noise);
    const double unit = lagged.sums[0] / expected[0], each = lagged.each_product();
    for (std::size_t band = 1; band < lag_bands.size(); ++band, ++at) {
      if (lagged.pairs[band] <= 0) continue;
      list[at] =
          (lagged.sums[band] - unit * expected[band]) / std::sqrt(lagged.cells * lagged.pairs[band] * each);
    }
  }
  return list;
}

double misfit(const ByLength& by_length, const Mixture& noise) {
  return deviations(by_length, noise).squaredNorm();
}

/// The likeliest of a grid, logarithmic in the share and in how long the memory is.
Mixture likeliest(const ByLength& by_length) {
  Mixture best;
  double least = misfit(by_length, best);
  for (double lasting = 0.4; lasting < 100; lasting *= 1.4)
    for (double share = 1; share > least_share; share /= 1.3) {
      const Mixture noise{std::exp(-1 / lasting), share};
      const double m = misfit(by_length, noise);
      if (m >= least) continue;
      least = m;
      best = noise;
    }
  return best;
}

/// How the deviations change with rho and with the share.
Eigen::MatrixX2d slopes(const ByLength& by_length, const Mixture& noise) {
  const Eigen::VectorXd here = deviations(by_length, noise);
  const double step_rho = 1e-4, step_share = 1e-3 * noise.share;
  Eigen::MatrixX2d slope(here.size(), 2);
  slope.col(0) = (here - deviations(by_length, {noise.rho - step_rho, noise.share})) / step_rho;
  slope.col(1) = (here - deviations(by_length, {noise.rho, noise.share - step_share})) / step_share;
  return slope;
}

/// Where hardly anything tells the two apart, they are what both can be at all.
Eigen::Matrix2d covariance_of(const Eigen::MatrixX2d& slope) {
  const Eigen::Matrix2d known_before = Eigen::Vector2d(4, 4).asDiagonal();
  return (slope.transpose() * slope + known_before).inverse();
}

/// Gauss-Newton from there.
Mixture refined(const ByLength& by_length, Mixture noise) {
  for (int step = 0; step < 8; ++step) {
    const Eigen::VectorXd here = deviations(by_length, noise);
    const Eigen::MatrixX2d slope = slopes(by_length, noise);
    const Eigen::Vector2d change = -covariance_of(slope) * (slope.transpose() * here);
    const Mixture next{std::clamp(noise.rho + change[0], least_rho, most_rho),
                       std::clamp(noise.share + change[1], least_share, 1.0)};
    if (!(misfit(by_length, next) < here.squaredNorm())) break;
    noise = next;
  }
  return noise;
}

/// How the deviations of one cell change with its sums: with their own, and by the unit that the variance
/// gives.
Eigen::MatrixXd changes_with_sums(const Lagged& lagged, const Mixture& noise) {
  constexpr auto bands = static_cast<Eigen::Index>(lag_bands.size());
  const LagSums expected = lagged.expected(noise);
  Eigen::MatrixXd change = Eigen::MatrixXd::Zero(bands - 1, bands);
  for (Eigen::Index band = 1; band < bands; ++band) {
    const auto b = static_cast<std::size_t>(band);
    if (lagged.pairs[b] <= 0) continue;
    const double scale = 1 / std::sqrt(lagged.pairs[b] * lagged.each_product());
    change(band - 1, band) = scale;
    change(band - 1, 0) = -scale * expected[b] / expected[0];
  }
  return change;
}

/// Standard uncertainties of rho and the share: products of noise with memory scatter more than those of
/// white noise, by which the deviations are weighed, and together.
Eigen::Vector2d uncertainties(const ByLength& by_length, const Mixture& noise) {
  const Eigen::MatrixX2d slope = slopes(by_length, noise);
  const Eigen::Matrix2d covariance = covariance_of(slope);
  constexpr auto rows = static_cast<Eigen::Index>(lag_bands.size()) - 1;
  Eigen::Matrix2d scatter = covariance.inverse() - slope.transpose() * slope;
  Eigen::Index first = 0;
  for (const auto& [n, lagged] : by_length) {
    const Eigen::MatrixXd change = changes_with_sums(lagged, noise);
    const auto own = slope.middleRows(first, rows);
    scatter += own.transpose() * change *
               (lagged.each_product() * covariance_of_lagged(n, noise.rho, noise.share)) *
               change.transpose() * own;
    first += rows;
  }
  return (covariance * scatter * covariance).diagonal().cwiseSqrt();
}

/// What the memory that some captures show gains in others; stretches of one that is long, if there is no
/// other. Not known of a single one.
std::optional<double> unseen_gain(const std::vector<Group>& groups) {
  std::set<int> captures;
  for (const Group& group : groups)
    if (tells_of_memory(group)) captures.insert(group.capture);
  const bool several = captures.size() > 1;
  std::set<int> parts = captures;
  const auto part_of = [&](std::size_t i) { return several ? groups[i].capture : static_cast<int>(i); };
  if (!several) {
    parts.clear();
    for (std::size_t i = 0; i < groups.size(); ++i)
      if (tells_of_memory(groups[i])) parts.insert(part_of(i));
  }
  if (parts.size() < 2) return {};
  const int blocks = static_cast<int>(std::min<std::size_t>(4, parts.size()));
  const std::map<int, int> block = block_of_capture(parts, blocks);
  Unseen unseen;
  for (int b = 0; b < blocks; ++b) {
    std::vector<Group> own, others;
    for (std::size_t i = 0; i < groups.size(); ++i)
      if (tells_of_memory(groups[i])) (block.at(part_of(i)) == b ? own : others).push_back(groups[i]);
    const ByLength taught = lagged_by_length(others), asked = lagged_by_length(own);
    unseen.add((misfit(asked, {}) - misfit(asked, refined(taught, likeliest(taught)))) / 2);
  }
  return unseen.gain();
}

/// Some captures show what others do not.
Unexplained memory_of_some_captures(const std::vector<Group>& groups, const Suspect& suspect) {
  Unexplained u;
  u.observable = Observable::time_correlation;
  u.coordinate = Coordinate::time;
  u.gain = suspect.gain;
  u.evidence = suspect.evidence;
  const auto [first, last] = std::ranges::minmax(groups, {}, &Group::time_s);
  u.from = first.time_s;
  u.to = last.time_s;
  u.describes =
      "the noise of beams repeats from scan to scan, but not as noise with one memory does: some captures do "
      "not confirm what the others show";
  return u;
}

/// The mean of n such values scatters more than their number says, and they scatter less about it.
double factor_of_means(const ByLength& by_length, const Mixture& noise) {
  double number = 0, factor = 0;
  for (const auto& [n, lagged] : by_length) {
    const double added = noise.share * added_to_mean(n, noise.rho);
    factor += lagged.cells * (1 + added) / std::max(0.05, 1 - added / (n - 1.0));
    number += lagged.cells;
  }
  return std::max(1.0, factor / number);
}

/// Correlations of samples so many scans apart: as recorded, without memory, and with that one.
SpreadCurve correlations(const ByLength& by_length, const Mixture& noise) {
  SpreadCurve curve;
  curve.shows = "correlation of a beam's samples";
  curve.observable = Observable::time_correlation;
  curve.coordinate = Coordinate::scan_seq;
  curve.along = "scans apart";
  for (std::size_t band = 1; band < lag_bands.size(); ++band) {
    double pairs = 0, recorded = 0, expected = 0, scatter = 0;
    for (const auto& [n, lagged] : by_length) {
      if (lagged.pairs[band] <= 0) continue;
      const LagSums with_memory = lagged.expected(noise);
      pairs += lagged.cells * lagged.pairs[band];
      // Deviations from a mean of so many are negatively correlated by themselves.
      recorded += lagged.sums[band] - lagged.sums[0] / lagged.white[0] * lagged.white[band];
      expected +=
          lagged.sums[0] * (with_memory[band] / with_memory[0] - lagged.white[band] / lagged.white[0]);
      scatter += lagged.cells * lagged.pairs[band] * lagged.each_product();
    }
    if (pairs <= 0) continue;
    curve.add((lag_bands[band].first + lag_bands[band].last) / 2.0,
              {recorded / pairs, std::sqrt(scatter) / pairs}, 0, expected / pairs);
  }
  return curve;
}

/// Noise with memory that these groups show best, as a suspect.
std::pair<Suspect, Mixture> suspect_in(const ByLength& by_length) {
  constexpr double lengths_of_memory = 3;
  const Mixture noise = refined(by_length, likeliest(by_length));
  Suspect suspect = suspected(ids::correlated_noise);
  suspect.gain = (misfit(by_length, {}) - misfit(by_length, noise)) / 2;
  suspect.evidence =
      suspect.gain - price_of_size(suspect.gain) - odds::against_place(suspect.gain, lengths_of_memory);
  return {suspect, noise};
}

}  // namespace

double evidence_of_memory(const std::vector<Group>& groups) {
  const ByLength by_length = lagged_by_length(groups);
  return by_length.empty() ? -1 : suspect_in(by_length).first.evidence;
}

double memory(const std::vector<Group>& groups, SpreadResult& result) {
  constexpr double all = 1, beyond_doubt = 20;
  const ByLength by_length = lagged_by_length(groups);
  if (by_length.empty()) return all;
  auto [suspect, noise] = suspect_in(by_length);
  if (suspect.evidence < accept_at) return all;
  const auto [rho, share] = noise;
  const Eigen::Vector2d u = uncertainties(by_length, noise);
  suspect.parameters = {{"rho", {rho, u[0]}}, {"share", {share, u[1]}}};
  // Fitted to some captures it must be seen in others, or it is only one of the ways to describe these.
  const std::optional<double> gain = unseen_gain(groups);
  if (gain.value_or(-1) <= 0) {
    if (gain && suspect.evidence > beyond_doubt)
      result.unknown.push_back(memory_of_some_captures(groups, suspect));
    else if (!is_suspected(result, ids::correlated_noise))
      result.undecided.push_back({suspect, Suspect{}});
  } else if (!is_suspected(result, ids::correlated_noise)) {
    suspect.held_out_gain = gain;
    result.accepted.push_back(suspect);
  }
  result.noise.factor = factor_of_means(by_length, noise);
  result.curves.push_back(correlations(by_length, noise));
  return (1 - rho * rho) / (1 + rho * rho) * share + (1 - share);
}

}  // namespace fit::explain::spread
