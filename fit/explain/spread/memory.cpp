// SPDX-License-Identifier: MIT
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "fit/explain/spread/autoregression.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {
namespace {

/// What groups of so many scans show together.
struct Lagged {
  LagSums sums{};      ///< Of products, in units of the variance.
  double squares = 0;  ///< Of products of neighbours, in units of the variance's square.
  double cells = 0;
};
using ByLength = std::map<int, Lagged>;

/// The white noise of a beam and noise with memory.
struct Mixture {
  double rho = 0, share = 0;  ///< Of the noise with memory, of the whole variance.
};
constexpr double least_rho = 0.05, most_rho = 0.99, least_share = 0.001;

ByLength lagged_by_length(const std::vector<Group>& groups) {
  ByLength by_length;
  for (const Group& group : groups) {
    if (group.scans < 4 || group.cells == 0) continue;
    Lagged& lagged = by_length[group.scans];
    const double scale = group.lagged[0] / (group.scans - 1.0) / static_cast<double>(group.cells);
    if (scale <= 0) continue;
    for (std::size_t band = 0; band < lag_bands.size(); ++band)
      lagged.sums[band] += group.lagged[band] / scale;
    lagged.squares += group.lagged_squares / (scale * scale);
    lagged.cells += static_cast<double>(group.cells);
  }
  return by_length;
}

/// Variance of one product in units of that of normal samples of equal variance: beams that differ in noise,
/// and samples that are not normal, make products scatter more.
double each_product(const Lagged& lagged, const LagSums& pairs) {
  return std::max(1.0, lagged.squares / (lagged.cells * pairs[1]));
}

/// Deviations of the sums from what is expected, in units of their standard deviations without memory.
Eigen::VectorXd deviations(const ByLength& by_length, const Mixture& noise) {
  Eigen::VectorXd list(static_cast<Eigen::Index>(by_length.size() * (lag_bands.size() - 1)));
  list.setZero();
  Eigen::Index at = 0;
  for (const auto& [n, lagged] : by_length) {
    const LagSums with = lagged_of(n, noise.rho), white = lagged_of(n, 0), pairs = pairs_of(n);
    const double unit = lagged.sums[0] / (noise.share * with[0] + (1 - noise.share) * white[0]);
    const double each = each_product(lagged, pairs);
    for (std::size_t band = 1; band < lag_bands.size(); ++band, ++at) {
      if (pairs[band] <= 0) continue;
      const double expected = unit * (noise.share * with[band] + (1 - noise.share) * white[band]);
      list[at] = (lagged.sums[band] - expected) / std::sqrt(lagged.cells * pairs[band] * each);
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

/// Standard uncertainties of rho and the share: products of noise with memory scatter more than those of
/// white noise, by which the deviations are weighed, and together.
Eigen::Vector2d uncertainties(const ByLength& by_length, const Mixture& noise) {
  const Eigen::MatrixX2d slope = slopes(by_length, noise);
  const Eigen::Matrix2d covariance = covariance_of(slope);
  constexpr auto bands = static_cast<Eigen::Index>(lag_bands.size());
  Eigen::Matrix2d scatter = covariance.inverse() - slope.transpose() * slope;
  Eigen::Index first = 0;
  for (const auto& [n, lagged] : by_length) {
    const LagSums with = lagged_of(n, noise.rho), white = lagged_of(n, 0), pairs = pairs_of(n);
    const auto expected = [&](std::size_t band) {
      return noise.share * with[band] + (1 - noise.share) * white[band];
    };
    // Of the deviations' changes with the sums: their own, and by the unit that the variance gives.
    Eigen::MatrixXd change = Eigen::MatrixXd::Zero(bands - 1, bands);
    const double each = each_product(lagged, pairs);
    for (Eigen::Index band = 1; band < bands; ++band) {
      const auto b = static_cast<std::size_t>(band);
      if (pairs[b] <= 0) continue;
      const double scale = 1 / std::sqrt(pairs[b] * each);
      change(band - 1, band) = scale;
      change(band - 1, 0) = -scale * expected(b) / expected(0);
    }
    const auto own = slope.middleRows(first, bands - 1);
    scatter += own.transpose() * change * (each * covariance_of_lagged(n, noise.rho, noise.share)) *
               change.transpose() * own;
    first += bands - 1;
  }
  return (covariance * scatter * covariance).diagonal().cwiseSqrt();
}

/// The mean of n such values scatters more than their number says, and they scatter less about it.
double factor_of_means(const ByLength& by_length, const Mixture& noise) {
  double number = 0, factor = 0;
  for (const auto& [n, lagged] : by_length) {
    double of_mean = 1, within = 1;
    for (int k = 1; k < n; ++k) {
      const double pair = pairs_at(k, n, noise.rho) * noise.share;
      of_mean += pair;
      within -= pair / (n - 1.0);
    }
    factor += lagged.cells * of_mean / std::max(0.05, within);
    number += lagged.cells;
  }
  return std::max(1.0, factor / number);
}

}  // namespace

double memory(const std::vector<Group>& groups, SpreadResult& result) {
  constexpr double all = 1, lengths_of_memory = 3;
  const ByLength by_length = lagged_by_length(groups);
  if (by_length.empty()) return all;
  const Mixture noise = refined(by_length, likeliest(by_length));
  Suspect suspect = suspected("correlated-noise");
  suspect.gain = (misfit(by_length, {}) - misfit(by_length, noise)) / 2;
  suspect.evidence =
      suspect.gain - price_of_size(suspect.gain) - odds::against_place(suspect.gain, lengths_of_memory);
  if (suspect.evidence < accept_at) return all;
  const auto [rho, share] = noise;
  const Eigen::Vector2d u = uncertainties(by_length, noise);
  suspect.parameters = {{"rho", {rho, u[0]}}, {"share", {share, u[1]}}};
  if (!is_accepted(result, "correlated-noise")) result.accepted.push_back(suspect);
  result.noise.factor = factor_of_means(by_length, noise);
  return (1 - rho * rho) / (1 + rho * rho) * share + (1 - share);
}

}  // namespace fit::explain::spread
