// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "fit/explain/spread/autoregression.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {
namespace {

/// What groups of so many scans show together.
struct Lagged {
  std::array<double, 4> sums{};  ///< Of products, in units of the variance.
  double cells = 0;
};
using ByLength = std::map<int, Lagged>;

/// The white noise of a beam and noise with memory.
struct Mixture {
  double rho = 0, share = 0;  ///< Of the noise with memory, of the whole variance.
};

ByLength lagged_by_length(const std::vector<Group>& groups) {
  ByLength by_length;
  for (const Group& group : groups) {
    if (group.scans < 4 || group.cells == 0) continue;
    auto& [sums, cells] = by_length[std::min(group.scans, 200)];
    const double scale = group.lagged[0] / (group.scans - 1.0) / static_cast<double>(group.cells);
    if (scale <= 0) continue;
    for (std::size_t k = 0; k < 4; ++k) sums[k] += group.lagged[k] / scale;
    cells += static_cast<double>(group.cells);
  }
  return by_length;
}

double misfit(const ByLength& by_length, const Mixture& noise) {
  double sum = 0;
  for (const auto& [n, lagged] : by_length) {
    const auto& [sums, cells] = lagged;
    const auto ar = lagged_of(n, noise.rho), white = lagged_of(n, 0);
    const double unit = sums[0] / (noise.share * ar[0] + (1 - noise.share) * white[0]);
    for (std::size_t k = 1; k <= 3 && static_cast<int>(k) < n; ++k) {
      const double expected = unit * (noise.share * ar[k] + (1 - noise.share) * white[k]);
      sum += std::pow(sums[k] - expected, 2) / (cells * (n - static_cast<double>(k)));
    }
  }
  return sum;
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
  constexpr double none = 1;
  const ByLength by_length = lagged_by_length(groups);
  if (by_length.empty()) return none;
  Mixture noise;
  const double before = misfit(by_length, noise);
  double best = before;
  for (const double rho : {0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.87, 0.93, 0.97})
    for (const double share : {0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0}) {
      const double m = misfit(by_length, {rho, share});
      if (m >= best) continue;
      best = m;
      noise = {rho, share};
    }
  Suspect suspect = suspected("correlated-noise");
  suspect.gain = (before - best) / 2;
  suspect.evidence = suspect.gain - price_of_size(suspect.gain) - odds::against_place(suspect.gain, 2);
  if (suspect.evidence < accept_at) return none;
  const auto [rho, share] = noise;
  const double u = 1 / std::sqrt(1 + suspect.gain);
  suspect.parameters = {{"rho", {rho, u}}, {"share", {share, u}}};
  if (!is_accepted(result, "correlated-noise")) result.accepted.push_back(suspect);
  result.noise.factor = factor_of_means(by_length, noise);
  return (1 - rho * rho) / (1 + rho * rho) * share + (1 - share);
}

}  // namespace fit::explain::spread
