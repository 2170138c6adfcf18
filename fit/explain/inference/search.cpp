// SPDX-License-Identifier: MIT
#include "fit/explain/inference/search.hpp"

#include <algorithm>
#include <optional>
#include <set>

#include "fit/explain/inference/pairs.hpp"
#include "fit/explain/inference/two_cores.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::inference {
namespace {

using numbers::tries;

Hypothesis without(const Hypothesis& h, std::size_t term) {
  Hypothesis less;
  less.terms = h.terms, less.base = h.base;
  less.terms.erase(less.terms.begin() + static_cast<std::ptrdiff_t>(term));
  return less;
}

Hypothesis with_term(const Hypothesis& h, const Term& term) {
  Hypothesis more;
  more.terms = h.terms, more.base = h.base;
  more.terms.push_back(term);
  return more;
}

/// Mechanisms and forms in turn, so that neither crowds out the other; those within so much of the best of
/// their sort.
std::vector<Candidate> best_of(const std::vector<Candidate>& list, std::size_t names, std::size_t forms,
                               double within = 2 * numbers::window) {
  std::vector<Candidate> chosen;
  double best_name = -1e300, best_form = -1e300;
  for (const Candidate& candidate : list) {
    std::size_t& left = candidate.term.kind->is_form() ? forms : names;
    double& best = candidate.term.kind->is_form() ? best_form : best_name;
    best = std::max(best, candidate.log_posterior());
    if (left == 0 || candidate.log_posterior() < std::max(numbers::worth_fitting, best - within)) continue;
    --left;
    chosen.push_back(candidate);
  }
  return chosen;
}

class Climber {
 public:
  Climber(Session& session, const Progress& progress) : session_(session), progress_(progress) {
    best_ = fitted({});
  }

  void climb() {
    constexpr int most_moves = 12;
    for (int move = 0; move < most_moves; ++move)
      if (!add() && !drop() && !exchange() && !take_better_visited() && !drop_of_others()) return;
  }

  /// One term more, if any improves.
  bool add() {
    if (best_.hypothesis.terms.size() >= numbers::most_terms) return false;
    const std::vector<Candidate> list = screened(best_.hypothesis);
    if (take_if_better(fit_each(best_.hypothesis, best_of(list, tries, forms(tries / 2))))) return true;
    // The approximation said too much of the best; others stood in its shadow.
    if (list.empty() || list.front().log_posterior() < numbers::window) return false;
    constexpr double any = 1e300;
    return take_if_better(fit_each(best_.hypothesis, best_of(list, 2 * tries, forms(tries), any)));
  }

  /// A form may stand where two mechanisms belong, of which neither shows by itself: from what is named, on
  /// with mechanisms alone.
  void climb_without_forms() {
    constexpr int most_moves = 4;
    const Fitted with_forms = best_;
    Hypothesis named = with_forms.hypothesis;
    std::erase_if(named.terms, [](const Term& term) { return term.kind->is_form(); });
    if (named.terms.size() == with_forms.hypothesis.terms.size()) return;
    best_ = fitted(named);
    const double from = best_.hypothesis.log_posterior(), to = with_forms.hypothesis.log_posterior();
    asks_forms_ = false;
    for (int move = 0; move < most_moves; ++move) {
      const double here = best_.hypothesis.log_posterior();
      const bool is_far =
          move > 1 && to - here > here - from;  // as each move brings less, it will not get there
      if (is_far || (!add() && !drop() && !exchange())) break;
    }
    asks_forms_ = true;
    if (best_.hypothesis.log_posterior() < to) best_ = with_forms;
  }

  /// Nothing is missing, and the session is linearised there.
  [[nodiscard]] bool is_where_it_began() const { return best_.hypothesis.terms.empty() && !moved_; }

  /// All that counts at the linearisation where the best one predicts. Returns whether the search would still
  /// find what it found: the best one is the same, and all others lie where they lay below it.
  bool fit_again() {
    constexpr double hardly = 0.5;  // fits are settled to a fifth of it
    const Hypothesis before = best_.hypothesis;
    // What lacks one of its terms decides whether that stays, however far below it lay before.
    std::set<std::vector<const Kind*>> decisive;
    for (std::size_t t = 0; t < before.terms.size(); ++t) decisive.insert(without(before, t).kinds());
    std::vector<Hypothesis> again;
    for (const auto& [kinds, h] : visited_)
      if (h.log_posterior() > before.log_posterior() - 2 * numbers::window || h.terms.empty() ||
          decisive.contains(kinds))
        again.push_back(h);
    session_.linearise(best_.hypothesis, again);
    moved_ = true;
    visited_.clear();
    screened_.clear();
    pairs_.clear();
    std::optional<Fitted> first = fit_all(again);
    best_ = std::move(*first);
    const double best = best_.hypothesis.log_posterior();
    return best_.hypothesis.kinds() == before.kinds() && std::ranges::all_of(again, [&](const Hypothesis& h) {
             const double now = visited_.at(h.kinds()).log_posterior() - best,
                          was = h.log_posterior() - before.log_posterior();
             return std::max(now, was) < -2 * numbers::window || std::abs(now - was) < hardly;
           });
  }

  Explored result() && { return {std::move(visited_), std::move(best_)}; }

 private:
  Fitted fitted(const Hypothesis& h) {
    Fitted f = fit(session_, h);
    remember(f);
    return f;
  }

  void remember(const Fitted& f) {
    const auto [known, is_new] = visited_.try_emplace(f.hypothesis.kinds(), f.hypothesis);
    if (!is_new && known->second.log_posterior() < f.hypothesis.log_posterior()) known->second = f.hypothesis;
  }

  /// What each kind would add to it, but one. It is fitted for that, from where it was fitted before, and is
  /// visited then.
  std::vector<Candidate> screened(const Hypothesis& h, const Kind* but = nullptr) {
    const auto [known, is_new] = screened_.try_emplace(h.kinds());
    const auto ask = [&](const Fitted& present) {
      const Optimum around = expanded_for_new_terms(session_, present.design, present.optimum);
      known->second = screen(session_, present, nullptr, false, &around);
      pairs_[h.kinds()] = pairs_beside(session_, present, around);
    };
    if (is_new && h.kinds() == best_.hypothesis.kinds()) {
      ask(best_);
    } else if (is_new) {
      const auto before = visited_.find(h.kinds());
      ask(fitted(before != visited_.end() ? before->second : h));
    }
    std::vector<Candidate> list = known->second;
    std::erase_if(list, [&](const Candidate& candidate) { return candidate.term.kind == but; });
    return list;
  }

  /// The best of them; all are remembered.
  std::optional<Fitted> fit_all(const std::vector<Hypothesis>& list) {
    std::vector<Fitted> fits(list.size());
    on_two_cores(list.size(), [&](std::size_t i) { fits[i] = fit(session_, list[i]); });
    compared_ += list.size();
    if (progress_ && !list.empty())
      progress_(unknown_share, std::to_string(compared_) + " hypotheses compared");
    std::optional<Fitted> best;
    for (Fitted& f : fits) {
      remember(f);
      if (!best || f.hypothesis.log_posterior() > best->hypothesis.log_posterior()) best = std::move(f);
    }
    return best;
  }

  bool take_if_better(std::optional<Fitted> other) {
    constexpr double hardly = 0.05;
    if (!other || !(other->hypothesis.log_posterior() > best_.hypothesis.log_posterior() + hardly))
      return false;
    best_ = std::move(*other);
    return true;
  }

  /// Fits a hypothesis with each of the candidates, but those that are known.
  std::optional<Fitted> fit_each(const Hypothesis& h, const std::vector<Candidate>& candidates) {
    std::vector<Hypothesis> list;
    for (const Candidate& candidate : candidates) {
      Hypothesis more = with_term(h, candidate.term);
      if (is_known(more)) continue;
      list.push_back(std::move(more));
      if (candidate.always) list.push_back(with_term(h, *candidate.always));
    }
    return fit_all(list);
  }

  bool drop() {
    std::vector<Hypothesis> list;
    add_shorter(best_.hypothesis, list);
    return take_if_better(fit_all(list));
  }

  /// What was exchanged may have made another term needless.
  bool drop_of_others() {
    std::vector<Hypothesis> list;
    for (const auto& [kinds, h] : visited_)
      if (h.log_posterior() > best_.hypothesis.log_posterior() - numbers::fits_as_well) add_shorter(h, list);
    return take_if_better(fit_all(list));
  }

  /// What begins and ends between recorded places stays where it was found: elsewhere it is another one.
  [[nodiscard]] bool is_known(const Hypothesis& h) const {
    const auto known = visited_.find(h.kinds());
    if (known == visited_.end()) return false;
    return std::ranges::all_of(h.terms, [&](const Term& term) {
      if (!term.kind->is_form() || !term.kind->form->form->from_to) return true;
      const auto& other = *std::ranges::find(known->second.terms, term.kind, &Term::kind);
      return std::equal(term.values.end() - 2, term.values.end(), other.values.end() - 2);
    });
  }

  /// Without each of its terms, but those that are known.
  void add_shorter(const Hypothesis& h, std::vector<Hypothesis>& list) const {
    if (h.terms.size() < 2) return;
    for (std::size_t t = 0; t < h.terms.size(); ++t) {
      Hypothesis less = without(h, t);
      if (!is_known(less) &&
          std::ranges::none_of(list, [&](const Hypothesis& other) { return other.kinds() == less.kinds(); }))
        list.push_back(std::move(less));
    }
  }

  bool exchange() {
    const Hypothesis whole = best_.hypothesis;
    if (whole.terms.size() > numbers::exchanged_terms) return false;
    bool better = false;
    for (std::size_t t = 0; t < whole.terms.size(); ++t) {
      const Hypothesis shorter = without(whole, t);
      const auto all = screened(shorter, whole.terms[t].kind);
      const auto list = best_of(all, tries, forms(tries / 2));
      const Hypothesis less = visited_.at(shorter.kinds());
      const double worth = whole.log_evidence - less.log_evidence;
      better = take_if_better(fit_each(less, list)) || better;
      better = exchange_for_two(less, all, *whole.terms[t].kind, worth) || better;
      better = exchange_for_pair(less, *whole.terms[t].kind, whole.log_posterior() - less.log_posterior()) ||
               better;
    }
    return better;
  }

  /// A term may look like two others together: those that do a good part of what it does, with one more.
  bool exchange_for_two(const Hypothesis& less, const std::vector<Candidate>& list, const Kind& instead_of,
                        double worth) {
    constexpr std::size_t most = 2;
    constexpr double good_part = 0.5;
    if (less.terms.size() + 2 > numbers::most_terms || worth < numbers::fits_as_well) return false;
    bool better = false;
    std::vector<const Kind*> asked;
    for (const Candidate& candidate : list) {
      if (asked.size() == most) break;
      const Kind& kind = *candidate.term.kind;
      if (kind.is_form() || kind.is_same_cause(instead_of) || candidate.log_evidence < good_part * worth ||
          std::ranges::any_of(asked, [&](const Kind* one) { return one->is_same_cause(kind); }))
        continue;
      asked.push_back(&kind);
      const Hypothesis first = with_term(less, candidate.term);
      auto all = screened(first);
      std::erase_if(all,
                    [&](const Candidate& second) { return second.term.kind->is_same_cause(instead_of); });
      const auto more = best_of(all, most, forms(1));
      better = take_if_better(fit_each(visited_.at(first.kinds()), more)) || better;
    }
    return better;
  }

  /// Of two that are straight neither need show by itself.
  bool exchange_for_pair(const Hypothesis& less, const Kind& instead_of, double worth) {
    if (less.terms.size() + 2 > numbers::most_terms) return false;
    std::vector<Hypothesis> list;
    for (const Pair& pair : pairs_[less.kinds()]) {
      if (list.size() == tries || pair.log_posterior() < worth - numbers::window) break;
      if (std::ranges::any_of(pair.terms,
                              [&](const Term& term) { return term.kind->is_same_cause(instead_of); }))
        continue;
      Hypothesis both = with_term(with_term(less, pair.terms[0]), pair.terms[1]);
      if (!visited_.contains(both.kinds())) list.push_back(std::move(both));
    }
    return take_if_better(fit_all(list));
  }

  /// What was fitted to be screened may turn out better than what it was screened for.
  bool take_better_visited() {
    const auto posterior = [](const auto& visited) { return visited.second.log_posterior(); };
    const Hypothesis& most = std::ranges::max_element(visited_, {}, posterior)->second;
    if (!(most.log_posterior() > best_.hypothesis.log_posterior())) return false;
    return take_if_better(fitted(Hypothesis(most)));
  }

  [[nodiscard]] std::size_t forms(std::size_t count) const { return asks_forms_ ? count : 0; }

  Session& session_;
  const Progress& progress_;
  std::map<std::vector<const Kind*>, Hypothesis> visited_;
  std::map<std::vector<const Kind*>, std::vector<Candidate>> screened_;
  std::map<std::vector<const Kind*>, std::vector<Pair>>
      pairs_;  ///< Of those that were fitted to be screened.
  Fitted best_;
  std::size_t compared_ = 0;
  bool asks_forms_ = true;
  bool moved_ = false;
};

}  // namespace

Hypothesis best_of_one(Session& session, const Progress& progress) {
  Climber climber(session, progress);
  climber.add();
  return std::move(climber).result().best.hypothesis;
}

Explored explore(Session& session, const Progress& progress) {
  constexpr int most_linearisations = 3;
  Climber climber(session, progress);
  for (int pass = 0; pass < most_linearisations; ++pass) {
    climber.climb();
    if (pass == 0) {
      climber.climb_without_forms();
      climber.climb();
    }
    if (climber.is_where_it_began()) break;
    if (climber.fit_again()) break;
  }
  return std::move(climber).result();
}

}  // namespace fit::explain::inference
