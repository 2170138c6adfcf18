// SPDX-License-Identifier: MIT
#include "fit/explain/search/judgement.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <utility>

#include "fit/explain/odds.hpp"
#include "fit/explain/search/candidates.hpp"
#include "fit/explain/search/climbing.hpp"
#include "fit/explain/search/figures.hpp"
#include "fit/explain/search/priors.hpp"
#include "fit/explain/search/transfer.hpp"

namespace fit::explain::search {
namespace {

constexpr double hardly_worse = 3, most_behind = 12;  // a rival that is simply more adjustable

/// Akaike's: how well it fits, less one for everything that its mechanisms adjusted to the recording, and
/// less the odds against sizes that physics hardly allows: they are no matter of how much there is to adjust.
double adjusted_fit(const Hypothesis& h) {
  double fit = h.density - h.adjusted;
  for (const Term& term : h.terms) fit -= odds::against(term);
  return fit;
}

/// How a hypothesis with another explanation in place of a term of `best` compares.
Rival rival_of(const Hypothesis& best, const Hypothesis& other, bool by_form) {
  Rival rival;
  if (by_form)
    rival.shape = other.shapes.back();
  else
    rival.term = other.terms.back();
  rival.behind =
      best.evidence - other.evidence + (by_form && other.terms.empty() ? preference(best, other) : 0);
  rival.fits_as_well = rival.behind < most_behind && adjusted_fit(other) > adjusted_fit(best) - hardly_worse;
  return rival;
}

/// Another explanation that is a mechanism of `best`, or one more, bending along its coordinate as it will.
/// It pays for every bend that nobody expected; so it is no rival by its evidence, but if it fits as well.
Rival rival_by_curve(const Hypothesis& best, const Hypothesis& other) {
  Rival rival;
  rival.term = other.terms.back();
  rival.behind = best.evidence - other.evidence;
  rival.fits_as_well = adjusted_fit(other) > adjusted_fit(best) - hardly_worse;
  return rival;
}

class Judgement {
 public:
  Judgement(Fitting& fitting, Hypothesis& best, MeanResult& result)
      : fitting_(fitting), best_(best), result_(result) {}

  void run() {
    while (!judge_once()) {
    }
    fitting_.fit(best_);
    fitting_.place(best_);
    result_.best = best_;
    result_.transfers = transfers_;
  }

 private:
  /// False if a better explanation came up among the rivals, and is to be judged instead: once.
  bool judge_once() {
    result_ = MeanResult(fitting_.bench());
    if (!keep_what_transfers(fitting_, best_)) transfers_ = false;
    const Blocks blocks = blocks_and_floor(fitting_, result_);
    while (drops_one(blocks)) {
    }
    result_.before = held_out_of_nothing(fitting_, blocks);
    for (std::size_t t = 0; t < best_.terms.size(); ++t) {
      const std::optional<Hypothesis> better = compare_with_rivals(t);
      if (!may_change_ || !better) continue;
      best_ = *better;
      may_change_ = false;
      return false;
    }
    return true;
  }

  /// Whether all that is left to explain is worth no name: much of it was explained by what is no part any
  /// more.
  [[nodiscard]] bool is_hardly_any(const Hypothesis& less) const {
    return best_.terms.size() == 1 && best_.shapes.empty() &&
           best_.evidence - less.evidence < odds::worth_a_first_name;
  }

  /// What does not help on captures it has not seen is not believed, unless the bench file's own uncertainties
  /// speak for it: these no other capture can repeat. They are never widened; that the file is wrong is one of
  /// the explanations that stand beside it, at a price of its own. False if all helps.
  bool drops_one(const Blocks& blocks) {
    result_.without.clear();
    result_.after = held_out(fitting_, best_, blocks);
    const std::vector<Hypothesis> each = fitting_.without_each(best_);
    for (std::size_t t = 0; t < best_.terms.size(); ++t) {
      const Hypothesis& less = each[t];
      result_.without.push_back(held_out(fitting_, less, blocks));
      const bool helps = result_.without.back().log_likelihood < result_.after.log_likelihood;
      if ((helps && !is_hardly_any(less)) || relieves_priors(best_, less, fitting_.bench())) continue;
      best_ = less;
      return true;
    }
    for (std::size_t s = best_.terms.size(); s < each.size(); ++s) {
      const Hypothesis& less = each[s];
      const bool helps = held_out(fitting_, less, blocks).log_likelihood < result_.after.log_likelihood;
      if (helps || relieves_priors(best_, less, fitting_.bench())) continue;
      best_ = less;
      return true;
    }
    return false;
  }

  /// Sets other explanations beside a term. Returns one that is better after all; then the result is not
  /// filled in if it may still change.
  std::optional<Hypothesis> compare_with_rivals(std::size_t term) {
    constexpr double clearly = 0.5;
    const Term& own = best_.terms[term];
    const Hypothesis less = fitting_.without(best_, term);
    const std::vector<Candidate> list =
        candidates(fitting_, less, {.but = &own, .unnamed = best_.shapes.empty()});
    std::vector<Hypothesis> in_place = in_place_of(own, less, list);
    const std::size_t as_they_are = in_place.size();
    std::vector<Hypothesis> free = bending_freely(own, less, list);
    std::ranges::move(free, std::back_inserter(in_place));
    fitting_.fit_all(in_place);
    std::vector<Rival> rivals;
    rivals.push_back({{}, {}, best_.evidence - less.evidence});
    std::optional<Hypothesis> better;
    for (std::size_t k = 0; k < as_they_are; ++k) {
      const Hypothesis& other = in_place[k];
      const bool by_form = other.shapes.size() > less.shapes.size();
      Rival rival = rival_of(best_, other, by_form);
      if (rival.behind < -clearly && (!better || better->evidence < other.evidence)) better = other;
      if (by_form && rival.behind > -clearly && says_any_curve_of(own, *rival.shape)) continue;
      if (by_form)
        rival.behind = std::max(std::min(0.0, rival.behind), rival.behind - odds::more_than_forms_show);
      rivals.push_back(rival);
    }
    for (std::size_t k = as_they_are; k < in_place.size(); ++k)
      rivals.push_back(rival_by_curve(best_, in_place[k]));
    std::ranges::sort(rivals, [](const Rival& a, const Rival& b) { return a.behind < b.behind; });
    if (!may_change_ || !better) add(rivals);
    return better;
  }
  /// Other explanations in place of a term, those that may come near it; of every form the best one.
  std::vector<Hypothesis> in_place_of(const Term& named, const Hypothesis& less,
                                      const std::vector<Candidate>& list) {
    constexpr double hopeless = 0.3, far_behind = 6;
    const std::size_t most = fitting_.has_patience() ? 7 : 3;
    std::vector<Hypothesis> others;
    std::set<const Form*> forms;
    std::size_t rivals = 0;
    for (const Candidate& candidate : list) {
      const bool by_form = candidate.shape.has_value();
      if (by_form && !forms.insert(candidate.shape->form).second) continue;
      const double first = list.front().evidence;
      const bool is_hopeless =
          candidate.evidence < hopeless * first && candidate.evidence < first - far_behind;
      if (rivals == most || (rivals > 1 && is_hopeless)) break;
      rivals += !by_form || !says_any_curve_of(named, *candidate.shape);
      others.push_back(with(less, candidate));
    }
    return others;
  }

  /// What of a term may be the curve of a mechanism of which only the coordinate is certain: one that nobody
  /// named so far, or one that stands beside it. A curve along the term's own coordinate says nothing against
  /// its formula. What bends is the last of the terms.
  std::vector<Hypothesis> bending_freely(const Term& named, const Hypothesis& less,
                                         const std::vector<Candidate>& list) {
    const auto is_another = [&](const Mechanism& m) {
      return m.any_curve && m.coordinate != named.mechanism->coordinate;
    };
    std::vector<Hypothesis> others;
    for (const Candidate& candidate : list) {
      if (candidate.shape || !is_another(*candidate.term.mechanism)) continue;
      others.push_back(with(less, candidate));
      others.back().terms.back().bends_freely = true;
    }
    for (std::size_t t = 0; t < less.terms.size(); ++t) {
      if (!is_another(*less.terms[t].mechanism) || less.terms[t].bends_freely) continue;
      others.push_back(less);
      auto& terms = others.back().terms;
      std::rotate(terms.begin() + static_cast<std::ptrdiff_t>(t),
                  terms.begin() + static_cast<std::ptrdiff_t>(t) + 1, terms.end());
      terms.back().bends_freely = true;
    }
    return others;
  }

  void add(const std::vector<Rival>& rivals) {
    double others = 0;
    std::set<std::pair<const Mechanism*, int>> named;  // each counts once, by its best curve
    for (const Rival& rival : rivals)
      if (!rival.term || named.emplace(rival.term->mechanism, rival.term->target).second)
        others += std::exp(-std::clamp(rival.behind, -30.0, 60.0));
    result_.probability.push_back(1 / (1 + others));
    result_.rivals.push_back(rivals);
  }

  Fitting& fitting_;
  Hypothesis& best_;
  MeanResult& result_;
  bool transfers_ = true;   ///< Nothing was dropped because other places do not confirm it.
  bool may_change_ = true;  ///< The last comparison may still find a better explanation, once.
};

}  // namespace

void judge(Fitting& fitting, Hypothesis& best, MeanResult& result) { Judgement(fitting, best, result).run(); }

}  // namespace fit::explain::search
