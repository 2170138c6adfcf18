// SPDX-License-Identifier: MIT
#include "fit/explain/search/aliases.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "fit/explain/sampling.hpp"

namespace fit::explain::search {
namespace {

/// One of the terms that are waves along the range.
struct Wave {
  std::size_t term, period;  ///< Indices of the term, and of the parameter.
  [[nodiscard]] double& period_mm(Hypothesis& h) const { return h.terms[term].values[period]; }
  [[nodiscard]] double period_mm(const Hypothesis& h) const { return h.terms[term].values[period]; }
};

std::vector<Wave> waves_of(const Hypothesis& h) {
  std::vector<Wave> waves;
  for (std::size_t t = 0; t < h.terms.size(); ++t) {
    const Mechanism& m = *h.terms[t].mechanism;
    if (m.coordinate != Coordinate::range) continue;
    if (const auto period = m.parameter_of(Parameter::Scale::wavelength)) waves.push_back({t, *period});
  }
  return waves;
}

/// That wave, and what it looks like from the rungs, each fitted.
std::vector<Hypothesis> aliases(Fitting& fitting, const Hypothesis& h, const Wave& wave, double rung) {
  const Parameter& bounds = h.terms[wave.term].mechanism->parameters[wave.period];
  std::vector<Hypothesis> list{h};
  for (const int turns : {-3, -2, -1, 1, 2, 3}) {
    const double other_mm = 1 / std::abs(1 / wave.period_mm(h) + turns / rung);
    if (other_mm < bounds.lower || other_mm > bounds.upper) continue;
    list.push_back(h);
    wave.period_mm(list.back()) = other_mm;
    fitting.fit(list.back());
  }
  return list;
}

/// The longest of those that fit as well.
Hypothesis told_of(const std::vector<Hypothesis>& all, const Wave& wave) {
  constexpr double as_good = 1.5;
  double top = -1e300, squares = 0, weight = 0;
  for (const Hypothesis& h : all) top = std::max(top, h.evidence);
  const Hypothesis* longest = nullptr;
  for (const Hypothesis& h : all)
    if (h.evidence > top - as_good && (!longest || wave.period_mm(h) > wave.period_mm(*longest)))
      longest = &h;
  for (const Hypothesis& h : all) {
    const double w = std::exp(h.evidence - top);
    squares += w * std::pow(wave.period_mm(h) - wave.period_mm(*longest), 2);
    weight += w;
  }
  Hypothesis told = *longest;
  double& sigma = told.terms[wave.term].sigma[wave.period];
  sigma = std::hypot(sigma, std::sqrt(squares / weight));
  return told;
}

}  // namespace

void doubt_aliases(Fitting& fitting, Hypothesis& best) {
  const std::optional<double> rung = rung_mm(fitting.reduced());
  if (!rung) return;
  for (const Wave& wave : waves_of(best)) {
    fitting.fit(best);
    best = told_of(aliases(fitting, best, wave, *rung), wave);
  }
}

}  // namespace fit::explain::search
