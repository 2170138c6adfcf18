// SPDX-License-Identifier: MIT
#include "fit/explain/inference/posterior.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "fit/explain/numbers.hpp"

namespace fit::explain::inference {
namespace {

/// What answers call the same: a mechanism, whatever its target, or any form.
const void* sort_of(const Kind& kind) {
  static const char any_form = 0;
  return kind.is_form() ? static_cast<const void*>(&any_form) : kind.mechanism.get();
}

bool holds(const Hypothesis& h, const void* sort) {
  return std::ranges::any_of(h.terms, [&](const Term& term) { return sort_of(*term.kind) == sort; });
}

/// Hypotheses that count, with their probabilities.
class Weighed {
 public:
  explicit Weighed(const Explored& explored) {
    const double most = explored.best.hypothesis.log_posterior();
    double sum = 0;
    for (const auto& [kinds, h] : explored.visited) {
      if (h.log_posterior() < most - numbers::window) continue;
      list_.push_back({&h, std::exp(h.log_posterior() - most)});
      sum += list_.back().second;
    }
    for (auto& one : list_) one.second /= sum;
    std::ranges::sort(list_, [](const auto& a, const auto& b) { return a.second > b.second; });
  }

  /// The fewest that together hold so much.
  [[nodiscard]] std::vector<Likely> likely() const {
    std::vector<Likely> most;
    double held = 0;
    for (const auto& [h, p] : list_) {
      if (held >= numbers::set_holds) break;
      most.push_back({*h, p});
      held += p;
    }
    return most;
  }

  [[nodiscard]] double probability_of(const void* sort) const {
    double sum = 0;
    for (const auto& [h, p] : list_)
      if (holds(*h, sort)) sum += p;
    return sum;
  }

  /// What stands in the place of a term of `best` in hypotheses without it; of no term: what else there is
  /// where nothing is best.
  [[nodiscard]] Undecided alternatives(const Hypothesis& best, const Term* term) const {
    std::map<const void*, Named> members;
    std::map<const void*, double> most;
    for (const auto& [h, p] : list_) {
      const Term* instead = in_place_of(*h, best, term);
      const void* sort = instead ? sort_of(*instead->kind) : nullptr;
      auto& member = members[sort];
      member.probability += p;
      if (!instead || p <= most[sort]) continue;
      most[sort] = p;
      member.term = *instead;
    }
    return smallest_set(members);
  }

  /// The term with what others that count make of the same cause in its uncertainty: plain or not, and with
  /// other terms beside it.
  [[nodiscard]] Term as_all_have_it(Term term) const {
    if (term.sigma.empty()) return term;
    std::vector<double> variance(term.values.size(), 0.0);
    double all = 0;
    for (const auto& [h, p] : list_)
      for (const Term& other : h->terms) {
        if (!other.kind->is_same_cause(*term.kind) || other.sigma.size() != term.sigma.size()) continue;
        all += p;
        for (std::size_t k = 0; k < variance.size(); ++k)
          variance[k] += p * (std::pow(other.sigma[k], 2) + std::pow(apart(other, term, k), 2));
      }
    for (std::size_t k = 0; all > 0 && k < variance.size(); ++k)
      term.sigma[k] = std::max(term.sigma[k], std::sqrt(variance[k] / all));
    return term;
  }

 private:
  /// By how much two have another value.
  static double apart(const Term& a, const Term& b, std::size_t k) {
    if (model::is_always(a.values[k]) || model::is_always(b.values[k])) return 0;
    const double difference = a.values[k] - b.values[k];
    const bool is_phase =
        !a.kind->is_form() && a.kind->mechanism->parameters[k].role == Parameter::Role::phase;
    return is_phase ? std::remainder(difference, 360) : difference;
  }

  /// The term itself where it is; another that is not in `best`; null if there is none.
  static const Term* in_place_of(const Hypothesis& h, const Hypothesis& best, const Term* term) {
    for (const Term& own : h.terms)
      if (term && sort_of(*own.kind) == sort_of(*term->kind)) return &own;
    for (const Term& own : h.terms)
      if (!holds(best, sort_of(*own.kind))) return &own;
    return nullptr;
  }

  static Undecided smallest_set(const std::map<const void*, Named>& members) {
    std::vector<Named> all;
    for (const auto& [sort, member] : members) all.push_back(member);
    std::ranges::sort(all, [](const auto& a, const auto& b) { return a.probability > b.probability; });
    Undecided set;
    double held = 0;
    for (const auto& member : all) {
      if (held >= numbers::set_holds) break;
      set.members.push_back(member);
      held += member.probability;
    }
    return set;
  }

  std::vector<std::pair<const Hypothesis*, double>> list_;
};

}  // namespace

Posterior posterior_of(const Explored& explored) {
  const Weighed weighed(explored);
  const Hypothesis& best = explored.best.hypothesis;
  Posterior result;
  result.likely = weighed.likely();
  if (best.terms.empty()) {
    Undecided set = weighed.alternatives(best, nullptr);
    if (set.members.front().probability < numbers::named_at) result.undecided.push_back(std::move(set));
    return result;
  }
  std::vector<const void*> listed_sorts;
  for (const Term& term : best.terms) {
    const void* sort = sort_of(*term.kind);
    const bool again = std::ranges::count(listed_sorts, sort) > 0;
    listed_sorts.push_back(sort);
    const double probability = weighed.probability_of(sort);
    if (probability >= numbers::named_at) {
      (term.kind->is_form() ? result.forms : result.named)
          .push_back({weighed.as_all_have_it(term), probability});
      continue;
    }
    if (again) continue;
    Undecided set = weighed.alternatives(best, &term);
    const Named& first = set.members.front();
    if (set.members.size() > 1)
      result.undecided.push_back(std::move(set));
    else if (const Kind* kind = first.term.kind)  // Many others together outweigh the best.
      (kind->is_form() ? result.forms : result.named).push_back(first);
  }
  return result;
}

}  // namespace fit::explain::inference
