// SPDX-License-Identifier: MIT
#include "fit/explain/search/priors.hpp"

#include <cmath>

#include "fit/explain/odds.hpp"

namespace fit::explain::search {
namespace {

/// How far mount and targets are from where the bench file states them, in the uncertainties believed.
Eigen::VectorXd strains(const Hypothesis& h, const Bench& bench) {
  Eigen::VectorXd list = h.nuisance.as_vector() - Nuisance(bench).as_vector();
  for (Eigen::Index i = 0; i < list.size(); ++i)
    list[i] = h.bench_u[i] > 0 ? std::abs(list[i]) / h.bench_u[i] : 0;
  return list;
}

double strain(const Hypothesis& h, const Bench& bench) { return 0.5 * strains(h, bench).squaredNorm(); }

}  // namespace

bool relieves_priors(const Hypothesis& best, const Hypothesis& less, const Bench& bench) {
  const double gain = best.evidence - less.evidence;
  return gain > odds::strained && strain(less, bench) - strain(best, bench) > 0.4 * gain;
}

}  // namespace fit::explain::search
