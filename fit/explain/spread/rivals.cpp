// SPDX-License-Identifier: MIT
#include "fit/explain/spread/rivals.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "fit/explain/spread/noise_columns.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/spread/variance_model.hpp"
#include "fit/explain/stated_noise.hpp"

namespace fit::explain::spread {
namespace {

/// Probability that an echo of so many counts is lost.
double lost(const Suspect& suspect, double intensity) {
  constexpr double rarest = 1e-6;
  if (!is(suspect, ids::dropout) || !suspect.parameters.contains("intensity_min")) return rarest;
  const double at = suspect.parameters.at("intensity_min").value,
               width = suspect.parameters.at("width").value;
  return std::clamp(1 / (1 + std::exp((intensity - at) / width)), rarest, 1 - rarest);
}

/// What cells would tell of echoes that one loses and the other does not.
double evidence_of_losses(const Reduced& reduced, const Suspect& truth, const Suspect& rival) {
  double sum = 0;
  for (const Cell& cell : reduced.cells) {
    if (!cell.smooth || !std::isfinite(cell.at.intensity)) continue;
    const double p = lost(truth, cell.at.intensity), q = lost(rival, cell.at.intensity);
    sum += cell.n * (p * std::log(p / q) + (1 - p) * std::log((1 - p) / (1 - q)));
  }
  return sum;
}

/// All ways in which a suspect may make noise: it keeps its place, and noise of weak echoes may take another
/// exponent.
std::vector<Parts> ways_of(const std::vector<Pool>& pools, const Suspect& suspect) {
  if (is(suspect, constant_noise)) {
    Parts constant;
    constant.free = true;
    return {constant};
  }
  if (!makes_noise(suspect)) return {Parts()};
  if (!is(suspect, ids::intensity_noise)) return {Parts().with(of_suspect(pools, suspect))};
  std::vector<Parts> ways;
  for (const double exponent : exponents_of_noise)
    ways.push_back(Parts().with(of_intensity(pools, exponent)));
  return ways;
}

/// The variance of every pool if that suspect is true, as large as it came out.
std::vector<Pool> expected(const Reduced& reduced, const Suspect& truth) {
  const VarianceModel recorded(pools_of(reduced), stated_noise(reduced.bench), 0, 1);
  std::vector<Pool> pools = recorded.pools();
  const Column column = of_suspect(pools, truth);
  const double constant = recorded.fit(Parts().with(column)).at(0).value, size = size_of(truth);
  for (std::size_t i = 0; i < pools.size(); ++i) pools[i].variance = constant + size * column[i];
  return pools;
}

/// What is expected of recordings if one suspect is true: how much likelier it makes them than others do.
class IfTrue {
 public:
  IfTrue(const Reduced& reduced, const Suspect& truth) : reduced_(reduced), truth_(truth) {
    if (!makes_noise(truth)) return;
    noise_.emplace(expected(reduced, truth), stated_noise(reduced.bench), 0, 1);
    own_ = likelihood_of(truth);
  }
  [[nodiscard]] double evidence_against(const Suspect& rival) const {
    const double of_losses = evidence_of_losses(reduced_, truth_, rival);
    // Echoes that are about to be lost scatter as much as any noise that is as steep.
    if (!noise_ || !makes_noise(rival)) return of_losses;
    return std::max(0.0, own_ - likelihood_of(rival)) + of_losses;
  }

 private:
  [[nodiscard]] double likelihood_of(const Suspect& suspect) const {
    double likelihood = -1e300;
    for (const Parts& way : ways_of(noise_->pools(), suspect))
      likelihood = std::max(likelihood, noise_->fit(way).log_likelihood);
    return likelihood;
  }

  const Reduced& reduced_;
  const Suspect& truth_;
  std::optional<VarianceModel> noise_;  ///< None of what makes none of its own: a dropout's is like its rival's.
  double own_ = 0;
};

}  // namespace

Eigen::MatrixXd evidence_between(const Reduced& reduced, const std::vector<Suspect>& suspects) {
  const auto count = static_cast<Eigen::Index>(suspects.size());
  Eigen::MatrixXd evidence = Eigen::MatrixXd::Zero(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const IfTrue one(reduced, suspects[static_cast<std::size_t>(i)]);
    for (Eigen::Index j = 0; j < count; ++j)
      if (i != j) evidence(i, j) = one.evidence_against(suspects[static_cast<std::size_t>(j)]);
  }
  return evidence;
}

}  // namespace fit::explain::spread
