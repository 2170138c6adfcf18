// SPDX-License-Identifier: MIT
#include "fit/explain/search/priors.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/odds.hpp"
#include "fit/explain/search/candidates.hpp"

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

void believe_bench_less(Hypothesis& h, const Bench& bench) {
  constexpr double strained = 2;
  const Eigen::VectorXd list = strains(h, bench);
  for (Eigen::Index i = 0; i < list.size(); ++i)
    if (list[i] > strained) h.bench_u[i] *= list[i];
}

std::vector<Term> only_priors(Fitting& fitting, const Term& term, const Hypothesis& less) {
  constexpr double as_good = 4;
  std::vector<Term> set{term};
  const std::vector<Candidate> list = candidates(fitting, less, {.unnamed = false});
  if (list.empty()) return set;
  const auto own = std::ranges::find_if(list, [&](const Candidate& s) { return s.term.same(term); });
  const double evidence = own == list.end() ? list.front().evidence : own->evidence;
  for (const Candidate& other : list) {
    if (set.size() > 4 || other.evidence < evidence - as_good) break;
    if (std::ranges::none_of(set, [&](const Term& t) { return t.mechanism == other.term.mechanism; }))
      set.push_back(other.term);
  }
  return set;
}

}  // namespace fit::explain::search
