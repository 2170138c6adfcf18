// SPDX-License-Identifier: MIT
#include "fit/explain/search/priors.hpp"

#include <algorithm>

#include "fit/explain/odds.hpp"
#include "fit/explain/search/candidates.hpp"

namespace fit::explain::search {
namespace {

/// Half the squared distance of mount and targets from what the bench file states, in its uncertainties.
double strain(const Hypothesis& h, const Bench& bench) {
  const Eigen::VectorXd u = Nuisance::prior_sigma(bench),
                        off = h.nuisance.as_vector() - Nuisance(bench).as_vector();
  double sum = 0;
  for (Eigen::Index i = 0; i < u.size(); ++i)
    if (u[i] > 0) sum += 0.5 * off[i] * off[i] / (u[i] * u[i]);
  return sum;
}

}  // namespace

bool relieves_priors(const Hypothesis& best, const Hypothesis& less, const Bench& bench) {
  const double gain = best.evidence - less.evidence;
  return gain > odds::strained && strain(less, bench) - strain(best, bench) > 0.4 * gain;
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
