// SPDX-License-Identifier: MIT
#include "fit/explain/search/aliases.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "fit/explain/sampling.hpp"

namespace fit::explain::search {
namespace {

constexpr std::size_t period = 2;  // of its parameters

/// That wave, and what it looks like from the rungs, each fitted.
std::vector<Hypothesis> aliases(Fitting& fitting, const Hypothesis& h, std::size_t wave, double rung) {
  const Parameter& bounds = h.terms[wave].mechanism->parameters[period];
  std::vector<Hypothesis> list{h};
  for (const int turns : {-3, -2, -1, 1, 2, 3}) {
    const double other_mm = 1 / std::abs(1 / h.terms[wave].values[period] + turns / rung);
    if (other_mm < bounds.lower || other_mm > bounds.upper) continue;
    list.push_back(h);
    list.back().terms[wave].values[period] = other_mm;
    fitting.fit(list.back());
  }
  return list;
}

/// The longest of those that fit as well.
Hypothesis told_of(const std::vector<Hypothesis>& all, std::size_t wave) {
  constexpr double as_good = 1.5;
  const auto period_of = [wave](const Hypothesis& h) { return h.terms[wave].values[period]; };
  double top = -1e300, squares = 0, weight = 0;
  for (const Hypothesis& h : all) top = std::max(top, h.evidence);
  const Hypothesis* longest = nullptr;
  for (const Hypothesis& h : all)
    if (h.evidence > top - as_good && (!longest || period_of(h) > period_of(*longest))) longest = &h;
  for (const Hypothesis& h : all) {
    const double w = std::exp(h.evidence - top);
    squares += w * std::pow(period_of(h) - period_of(*longest), 2);
    weight += w;
  }
  Hypothesis told = *longest;
  double& sigma = told.terms[wave].sigma[period];
  sigma = std::hypot(sigma, std::sqrt(squares / weight));
  return told;
}

}  // namespace

void doubt_aliases(Fitting& fitting, Hypothesis& best) {
  const std::optional<double> rung = rung_mm(fitting.reduced());
  if (!rung) return;
  for (std::size_t t = 0; t < best.terms.size(); ++t) {
    if (best.terms[t].mechanism->id != "cyclic-error") continue;
    fitting.fit(best);
    best = told_of(aliases(fitting, best, t, *rung), t);
  }
}

}  // namespace fit::explain::search
