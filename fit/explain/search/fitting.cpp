// SPDX-License-Identifier: MIT
#include "fit/explain/search/fitting.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fit/explain/odds.hpp"
#include "fit/explain/sampling.hpp"
#include "fit/explain/search/two_cores.hpp"

namespace fit::explain::search {
namespace {

using Eigen::Index;
using Role = Parameter::Role;

// Fits after which a search stops trying other ways: twice what any recording of one or two effects needed.
constexpr double rows_of_patience = 6e6, least_patience = 200, most_patience = 1000;

/// Beside a name, what is left is sooner a fault of its formula.
double price_of_unnamed(const Hypothesis& h) {
  return static_cast<double>(h.shapes.size()) *
         (odds::price_of_unknown + (h.terms.empty() ? 0 : odds::worth_a_name));
}

/// The log of the marginal likelihood, less what the hypothesis costs.
double evidence_of(const Hypothesis& h, double log_likelihood, double price_of_columns, std::size_t targets) {
  double evidence = log_likelihood - price_of_columns -
                    odds::price_of_mechanism * static_cast<double>(h.terms.size()) - price_of_unnamed(h);
  for (const Shape& shape : h.shapes) evidence -= shape.price;
  if (!h.terms.empty() || !h.shapes.empty()) evidence += odds::something_is_missing;
  for (const Term& term : h.terms) {
    evidence -= odds::against(term);
    if (term.mechanism->one_target) evidence -= std::log(static_cast<double>(targets));
  }
  return evidence;
}

/// How many coefficients of mechanisms and forms the recording sets, not priors.
double adjusted(const MeanModel::Posterior& posterior, const Prior& prior, Index nuisances) {
  double sum = 0;
  for (Index k = nuisances; k < posterior.value.size(); ++k)
    if (const double free = prior.sigma[k]; free > 0) sum += 1 - posterior.covariance(k, k) / (free * free);
  return sum;
}

/// Steps to where the linear model has its posterior: mount and walls, mechanisms, forms.
void step_to(const MeanModel::Posterior& posterior, const Base& base, Hypothesis& h) {
  const Eigen::VectorXd nuisance = h.nuisance.as_vector();
  h.nuisance.set(nuisance + posterior.value.head(nuisance.size()));
  for (std::size_t t = 0; t < h.terms.size(); ++t) {
    Term& term = h.terms[t];
    const Index first = base.term_first[t], count = base.term_count[t];
    const std::vector<double> now = linear_coefficients(term);
    Eigen::VectorXd x = posterior.value.segment(first, count);
    for (std::size_t k = 0; k < now.size(); ++k) x[static_cast<Index>(k)] += now[k];
    set_coefficients(term, x, posterior.covariance.block(first, first, count, count));
  }
  for (std::size_t s = 0; s < h.shapes.size(); ++s) {
    const Index first = base.shape_first[s], last = base.shape_first[s + 1];
    h.shapes[s].values.assign(posterior.value.data() + first, posterior.value.data() + last);
  }
}

/// Part of the way from one to the other, which differs in values only.
Hypothesis on_the_way(const Hypothesis& from, const Hypothesis& to, double share) {
  if (share >= 1) return to;
  const auto mixed = [share](const auto& a, const auto& b) { return (1 - share) * a + share * b; };
  Hypothesis between = to;
  between.nuisance.set(mixed(from.nuisance.as_vector(), to.nuisance.as_vector()));
  for (std::size_t t = 0; t < to.terms.size(); ++t) {
    Term& term = between.terms[t];
    const std::vector<double> a = linear_coefficients(from.terms[t]), b = linear_coefficients(to.terms[t]);
    Eigen::VectorXd middle(static_cast<Index>(a.size()));
    for (std::size_t k = 0; k < a.size(); ++k) middle[static_cast<Index>(k)] = mixed(a[k], b[k]);
    for (std::size_t k = 0; k < term.values.size(); ++k)
      if (term.mechanism->parameters[k].role == Role::shape)
        term.values[k] = mixed(from.terms[t].values[k], to.terms[t].values[k]);
    const std::vector<double> sigma = term.sigma;
    set_coefficients(term, middle, Eigen::MatrixXd::Zero(middle.size(), middle.size()));
    term.sigma = sigma;
  }
  return between;
}

Hypothesis less_one(Hypothesis h, std::size_t k) {
  if (k < h.terms.size())
    h.terms.erase(h.terms.begin() + static_cast<std::ptrdiff_t>(k));
  else
    h.shapes.erase(h.shapes.begin() + static_cast<std::ptrdiff_t>(k - h.terms.size()));
  return h;
}

}  // namespace

Fitting::Fitting(Reduced& reduced, MeanNoise noise)
    : reduced_(reduced), stops_apart_deg_(explain::stops_apart_deg(reduced)), noise_(std::move(noise)) {}

MeanModel Fitting::placed_model(const Hypothesis& h) {
  place(h);
  return model_of(reduced_, noise_, h);
}

Fitting::Trial Fitting::tried(Reduced& reduced, const Hypothesis& h) const {
  predict_at(reduced, h);
  MeanModel model(reduced, noise_);
  Base base = base_columns(model, h);
  model.set_base(std::move(base.all.columns_mm), base.all.prior);
  const MeanModel::Posterior posterior = model.posterior();
  const Index nuisances = h.nuisance.as_vector().size();
  Trial trial{h, h, model.density_here(nuisances)};
  Hypothesis& next = trial.next;
  step_to(posterior, base, next);
  next.evidence = evidence_of(next, posterior.log_evidence, base.all.price, bench().targets.size());
  next.density = trial.density;
  next.adjusted = adjusted(posterior, base.all.prior, nuisances);
  return trial;
}

/// Steps until the evidence has settled. That of the first step is a promise of the linear model around the
/// values before it, and is not counted. Before a wall that is met squarely, mount and wall turn ranges to
/// second order only: there a whole step would go back and forth between two sides.
int Fitting::fit_by(Reduced& reduced, Hypothesis& h) const {
  constexpr int usual_steps = 5, most_steps = 25;
  constexpr double settled = 0.05, least_share = 0.1;
  int trials = 0;
  const auto try_at = [&](const Hypothesis& there) {
    ++trials;
    return tried(reduced, there);
  };
  Trial now = try_at(h);
  Hypothesis best = now.next;
  best.evidence = -1e300;
  double share = 1;
  while (trials < (share < 1 ? most_steps : usual_steps)) {
    Trial then = try_at(on_the_way(now.here, now.next, share));
    if (then.density < now.density - settled) {
      share /= 2;
      if (share < least_share && best.evidence > -1e299) break;
      if (share >= least_share) continue;
    }
    const double settling = std::abs(then.next.evidence - now.next.evidence);
    now = std::move(then);
    if (now.next.evidence > best.evidence || share < 1) {
      best = on_the_way(now.here, now.next, share);
      best.evidence = now.next.evidence;
      best.density = now.density;
    }
    if (settling < settled) break;
  }
  h = best;
  return trials;
}

void Fitting::fit(Hypothesis& h) { fits_ += fit_by(reduced_, h); }

void Fitting::fit_all(std::vector<Hypothesis>& list) {
  if (list.empty()) return;
  if (list.size() == 1) return fit(list.front());
  // Each core has its own cells, and its own half of the list whichever is faster: how cells were predicted
  // last is where the next prediction begins.
  Reduced other = merged(reduced_, std::max<std::size_t>(1, reduced_.cells.size()));
  const auto half = [&](Reduced& cells, std::size_t first, int& trials) {
    for (std::size_t i = first; i < list.size(); i += 2) trials += fit_by(cells, list[i]);
  };
  int here = 0, there = 0;
  at_the_same_time([&] { half(reduced_, 0, here); }, [&] { half(other, 1, there); });
  fits_ += here + there;
}

Hypothesis with(const Hypothesis& h, const Candidate& candidate) {
  Hypothesis more = h;
  if (candidate.shape) {
    more.shapes.push_back(*candidate.shape);
  } else {
    Term term = candidate.term;
    term.sigma.clear();
    more.terms.push_back(term);
  }
  return more;
}

Hypothesis Fitting::without(const Hypothesis& h, std::size_t k) {
  Hypothesis less = less_one(h, k);
  fit(less);
  return less;
}

std::vector<Hypothesis> Fitting::without_each(const Hypothesis& h) {
  std::vector<Hypothesis> list;
  for (std::size_t k = 0; k < h.terms.size() + h.shapes.size(); ++k) list.push_back(less_one(h, k));
  fit_all(list);
  return list;
}

bool Fitting::has_patience() {
  const double limit = std::clamp(rows_of_patience / static_cast<double>(reduced_.cells.size()),
                                  least_patience, most_patience);
  cut_short_ = cut_short_ || fits_ > limit;
  return !cut_short_;
}

}  // namespace fit::explain::search
