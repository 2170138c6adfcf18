// SPDX-License-Identifier: MIT
#include "fit/explain/inference/alike.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <numeric>
#include <set>
#include <string>

#include "fit/explain/inference/screen.hpp"
#include "fit/explain/inference/steps.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::inference {
namespace {

/// Names without a mechanism, of what the bench file states: nothing but priors tells them from the others.
bool is_of_bench_file(const std::string& name) { return !find_mechanism(name); }

/// Ranks of values, equal ones alike; from -1 to 1.
Eigen::VectorXd ranks_of(const std::vector<double>& values) {
  std::vector<double> sorted = values;
  std::ranges::sort(sorted);
  Eigen::VectorXd ranks(static_cast<Eigen::Index>(values.size()));
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto [first, last] = std::equal_range(sorted.begin(), sorted.end(), values[i]);
    const auto below = static_cast<double>(first - sorted.begin()),
               up_to = static_cast<double>(last - sorted.begin());
    ranks[static_cast<Eigen::Index>(i)] = (below + up_to) / static_cast<double>(values.size()) - 1;
  }
  return ranks;
}

/// Where one coordinate of the means goes with the other, up or down (Spearman's rank correlation), their
/// functions look alike.
bool confounded(const Session& session, Coordinate a, Coordinate b) {
  const auto& means = session.channels()[model::channel_of("mean")];
  if (a == b || !means) return false;
  std::vector<double> of_a, of_b;
  for (Eigen::Index i = 0; i < means->rows(); ++i) {
    const double x = model::coordinate_of(a, means->at(i)), y = model::coordinate_of(b, means->at(i));
    if (!std::isfinite(x) || !std::isfinite(y)) continue;
    of_a.push_back(x);
    of_b.push_back(y);
  }
  if (of_a.empty()) return false;
  const Eigen::VectorXd x = ranks_of(of_a), y = ranks_of(of_b);
  const double scale = x.norm() * y.norm();
  return scale > 0 && std::abs(x.dot(y)) > numbers::goes_with * scale;
}

/// Whether a mechanism may be what looks like another one in this session.
bool may_be(const Session& session, const Mechanism& m, const Mechanism& other) {
  if (m.id == other.id) return false;
  if (std::ranges::count(other.looks_like, m.id)) return true;
  return m.observable == other.observable && !m.geometric && !other.geometric &&
         confounded(session, other.coordinate, m.coordinate);
}

/// Whether another hypothesis fits as well, all in all and in every channel, as the best one does with a term
/// whose formula leaves that share of its cause.
bool fits_as_well(const Fitted& other, const Fitted& best, const Fitted& without, double share) {
  const auto loses_little = [&](double others, double bests, double withouts) {
    return others >= bests - equivalence_margin(share, bests - withouts);
  };
  for (std::size_t c = 0; c < best.optimum.of_channel.size(); ++c)
    if (!loses_little(other.optimum.of_channel[c], best.optimum.of_channel[c], without.optimum.of_channel[c]))
      return false;
  return loses_little(other.hypothesis.log_fit, best.hypothesis.log_fit, without.hypothesis.log_fit);
}

/// The best hypothesis without a term; of no kind: without all functions.
Hypothesis best_without(const Fitted& best, const Kind* kind) {
  return best.hypothesis.less(
      [&](const Term& term) { return kind ? term.kind == kind : term.kind->is_form(); });
}

/// In the place of a term of the best hypothesis, as well as the recording tells: what may be one of those
/// mechanisms, as far as formulas err; and whatever else leaves that in doubt, as far as they do where they
/// may bend.
std::vector<Named> rivals_of(const Session& session, const Fitted& best, Fits& fits, const Term& term,
                             double probability, const std::vector<const Mechanism*>& mechanisms) {
  const auto may_be_one = [&](const Mechanism& m) {
    return std::ranges::any_of(mechanisms, [&](const Mechanism* one) { return may_be(session, m, *one); });
  };
  const Fitted& without = fits(best_without(best, term.kind));
  const double gain = best.hypothesis.log_fit - without.hypothesis.log_fit,
               error = term.kind->mechanism->formula_error;
  const auto own = std::ranges::find(best.hypothesis.terms, term.kind, &Term::kind);
  const double left = term.kind->mechanism->any_curve ? 0  // what bends at will leaves nothing
                      : own == best.hypothesis.terms.end()
                          ? error
                          : share_left(best, static_cast<std::size_t>(own - best.hypothesis.terms.begin()));
  if (equivalence_margin(left, gain) == numbers::fits_as_well &&
      std::ranges::none_of(catalogue(), may_be_one))
    return {};
  const double least = best.hypothesis.log_posterior() - without.hypothesis.log_posterior() -
                       equivalence_margin(left, gain) - numbers::window;
  std::vector<Named> rivals;
  for (const Candidate& candidate : screen(session, without, term.kind, true)) {
    if (candidate.term.kind->is_form() || candidate.term.kind->is_same_cause(*term.kind)) continue;
    const bool is_another_name = may_be_one(*candidate.term.kind->mechanism);
    if (!is_another_name && candidate.log_posterior() < least) continue;
    Hypothesis other = best_without(best, term.kind);
    other.terms.push_back(candidate.term);
    const Fitted fitted = fit(session, other);
    const double share = is_another_name ? error : left;
    if (!fits_as_well(fitted, best, without, share)) continue;
    // What a formula's error may lose says nothing against it.
    const double counts = numbers::fits_as_well / equivalence_margin(share, gain),
                 log_odds = counts * (fitted.hypothesis.log_posterior() - best.hypothesis.log_posterior()),
                 odds = std::exp(std::min(log_odds, numbers::window));
    if (log_odds < -numbers::window || (!is_another_name && odds < 1 / numbers::named_at - 1)) continue;
    rivals.push_back({fitted.hypothesis.terms.back(), odds * probability});
  }
  return rivals;
}

/// What the other terms leave of their causes may look like a mechanism, which gains at most as much as that
/// costs (docs/method/model.md, 7). A function that nobody stated is its cause to within a share of it. So is
/// a formula; where its smooth deviations are in the model, they leave the same share of what it errs by.
class DiscrepancyOfOthers {
 public:
  DiscrepancyOfOthers(const Fitted& best, Fits& fits) : best_(best), fits_(fits) {
    const auto is_form = [](const Term& term) { return term.kind->is_form(); };
    const auto first = std::ranges::find_if(best.hypothesis.terms, is_form);
    if (first != best.hypothesis.terms.end())
      add(*first, numbers::function_error, fits(best_without(best, nullptr)));
    if (best.hypothesis.terms.size() < 2) return;
    for (std::size_t t = 0; t < best.hypothesis.terms.size(); ++t) {
      const Term& term = best.hypothesis.terms[t];
      if (const double share = share_left(best, t); share > 0)
        add(term, share, fits(best_without(best, term.kind)));
    }
  }

  /// What there is instead of what is named, where it may be no more than that: a function, or nothing.
  [[nodiscard]] std::vector<Named> instead_of(const Named& named) const {
    if (!best_.hypothesis.has(*named.term.kind)) return {};
    double may_gain = 0, of_functions = 0;
    const Term* function = nullptr;
    for (const Other& other : others_) {
      if (other.term->kind->mechanism == named.term.kind->mechanism) continue;
      double gain = 0;
      for (std::size_t c = 0; c < other.costs.size(); ++c)
        if (named.term.kind->acts_in[c]) gain += other.costs[c];
      may_gain += gain;
      if (!other.term->kind->is_form()) continue;
      function = other.term;
      of_functions = gain;
    }
    if (may_gain == 0) return {};
    const Fitted& without = fits_(best_without(best_, named.term.kind));
    const double log_odds = best_.hypothesis.log_posterior() - without.hypothesis.log_posterior() - may_gain;
    const double probability = 1 / (1 + std::exp(-std::max(0.0, log_odds)));
    if (probability >= numbers::named_at) return {};
    return {{of_functions > may_gain / 2 ? *function : Term{},
             named.probability * (1 - probability) / probability}};
  }

 private:
  struct Other {
    const Term* term;
    std::vector<double> costs;  ///< By channel.
  };
  void add(const Term& term, double share, const Fitted& without) {
    Other other{&term, {}};
    for (std::size_t c = 0; c < best_.optimum.of_channel.size(); ++c)
      other.costs.push_back(share * share *
                            std::max(0.0, best_.optimum.of_channel[c] - without.optimum.of_channel[c]));
    others_.push_back(std::move(other));
  }

  const Fitted& best_;
  Fits& fits_;
  std::vector<Other> others_;
};

std::vector<std::string> names_of_bench_file(const Term& term) {
  std::vector<std::string> names;
  std::ranges::copy_if(term.kind->mechanism->looks_like, std::back_inserter(names), is_of_bench_file);
  return names;
}

bool is_same(const Named& a, const Named& b) {
  const Kind *one = a.term.kind, *other = b.term.kind;
  return one && other ? one->is_same_cause(*other) : one == other;
}

/// Whether both are open between the same causes, as of what is local and there twice.
bool is_same_question(const Undecided& a, const Undecided& b) {
  return a.members.size() == b.members.size() && std::ranges::all_of(a.members, [&](const Named& one) {
           return std::ranges::any_of(b.members, [&](const Named& other) { return is_same(one, other); });
         });
}

/// They have a part of what the set holds.
void join(const std::vector<Named>& rivals, Undecided& set) {
  const auto held = [&] {
    return std::transform_reduce(set.members.begin(), set.members.end(), 0.0, std::plus(),
                                 [](const Named& member) { return member.probability; });
  };
  const double before = held();
  for (const Named& rival : rivals)
    if (std::ranges::none_of(set.members, [&](const Named& m) { return is_same(m, rival); }))
      set.members.push_back(rival);
  const double share = before / held();
  for (Named& member : set.members) member.probability *= share;
}

}  // namespace

double equivalence_margin(double share, double gain) {
  return std::max(numbers::fits_as_well, share * share * gain);
}

double share_left(const Fitted& best, std::size_t term) {
  const double error = best.hypothesis.terms[term].kind->mechanism->formula_error;
  return best.design.blocks[term].deviations > 0 ? error * error : error;
}

void join_what_looks_alike(const Session& session, const Fitted& best, Fits& fits, Posterior& posterior) {
  const DiscrepancyOfOthers left(best, fits);
  std::vector<Named> alone;
  for (const Named& named : posterior.named) {
    std::vector<Named> rivals =
        rivals_of(session, best, fits, named.term, named.probability, {named.term.kind->mechanism.get()});
    std::ranges::copy(functions_instead(session, best, named), std::back_inserter(rivals));
    std::ranges::copy(left.instead_of(named), std::back_inserter(rivals));
    const std::vector<std::string> also = names_of_bench_file(named.term);
    if (rivals.empty() && also.empty()) {
      alone.push_back(named);
      continue;
    }
    Undecided set{{named}, also};
    join(rivals, set);
    posterior.undecided.push_back(std::move(set));
  }
  posterior.named = std::move(alone);
  for (Undecided& set : posterior.undecided) {
    std::vector<const Mechanism*> mechanisms;
    for (const auto& [term, probability] : set.members)
      if (term.kind && !term.kind->is_form()) mechanisms.push_back(term.kind->mechanism.get());
    for (const auto& [term, probability] : std::vector(set.members)) {
      if (!term.kind) continue;
      if (best.hypothesis.has(*term.kind))
        join(rivals_of(session, best, fits, term, probability, mechanisms), set);
      if (term.kind->is_form()) continue;
      for (const std::string& name : names_of_bench_file(term))
        if (!std::ranges::count(set.also, name)) set.also.push_back(name);
    }
  }
  std::vector<Undecided> each;
  for (Undecided& set : posterior.undecided)
    if (std::ranges::none_of(each, [&](const Undecided& other) { return is_same_question(set, other); }))
      each.push_back(std::move(set));
  posterior.undecided = std::move(each);
}

}  // namespace fit::explain::inference
