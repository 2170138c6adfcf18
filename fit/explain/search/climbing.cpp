// SPDX-License-Identifier: MIT
#include "fit/explain/search/climbing.hpp"

#include <algorithm>
#include <set>
#include <utility>

#include "fit/explain/odds.hpp"
#include "fit/explain/search/candidates.hpp"

namespace fit::explain::search {
namespace {

constexpr std::size_t most_together = 4;  // terms and shapes of a hypothesis

/// Whether it is a mechanism of which only the coordinate is certain, not the curve.
bool has_any_curve(const Candidate& candidate) {
  return !candidate.shape && candidate.term.mechanism->any_curve;
}

/// The best of a list, fitted. What may bend was looked at as stiff as its formula, and has its chance
/// whatever that is worth.
std::vector<Hypothesis> best_of(Fitting& fitting, const Hypothesis& h, const std::vector<Candidate>& list,
                                std::size_t tries) {
  constexpr double hopeless = 15;
  std::vector<Hypothesis> results;
  if (!fitting.has_patience()) tries = 1;
  for (const Candidate& candidate : list) {
    const bool is_cut = results.size() >= tries || candidate.evidence < list.front().evidence - hopeless;
    if (!is_cut || has_any_curve(candidate)) results.push_back(with(h, candidate));
  }
  fitting.fit_all(results);
  std::ranges::sort(results, [](const auto& a, const auto& b) { return a.evidence > b.evidence; });
  return results;
}

/// The best hypothesis with one more, if that is worth it.
std::optional<Hypothesis> with_one_more(Fitting& fitting, const Hypothesis& h, const Way& way) {
  if (h.terms.size() + h.shapes.size() >= most_together) return std::nullopt;
  std::vector<Candidate> list = candidates(fitting, h, {.unnamed = way.unnamed && h.shapes.size() < 2});
  // Unnamed functions are many: only the best of them competes.
  bool unnamed = false;
  std::erase_if(list, [&](const Candidate& s) { return s.shape ? std::exchange(unnamed, true) : false; });
  const std::vector<Hypothesis> more = best_of(fitting, h, list, way.tries);
  if (more.empty()) return std::nullopt;
  const bool first = h.terms.empty() && h.shapes.empty();
  const double worth = !first                        ? odds::worth_a_move
                       : more.front().shapes.empty() ? odds::worth_a_first_name
                                                     : odds::worth_a_first_form;
  if (!(more.front().evidence > h.evidence + worth)) return std::nullopt;
  return more.front();
}

/// Without what is not worth it beside the rest.
Hypothesis pruned(Fitting& fitting, Hypothesis h) {
  while (h.terms.size() + h.shapes.size() > 1) {
    const std::vector<Hypothesis> less = fitting.without_each(h);
    const auto enough = std::ranges::find_if(
        less, [&](const Hypothesis& one) { return one.evidence >= h.evidence - odds::worth_a_move; });
    if (enough == less.end()) break;
    h = *enough;
  }
  return h;
}

/// The best with one mechanism or unnamed function exchanged for another mechanism.
Hypothesis exchanged(Fitting& fitting, const Hypothesis& h, std::size_t tries) {
  Hypothesis best = h;
  const std::vector<Hypothesis> less = fitting.without_each(h);
  for (std::size_t t = 0; t < h.terms.size(); ++t) {
    const auto list = candidates(fitting, less[t], {.but = &h.terms[t], .unnamed = false});
    for (const Hypothesis& other : best_of(fitting, less[t], list, tries))
      if (other.evidence > best.evidence) best = other;
  }
  // A named mechanism that does what an unnamed function did may make others needless too.
  for (std::size_t s = h.terms.size(); s < less.size(); ++s) {
    const auto list = candidates(fitting, less[s], {.unnamed = false});
    for (const Hypothesis& other : best_of(fitting, less[s], list, tries)) {
      const Hypothesis fewer = pruned(fitting, other);
      if (fewer.evidence > best.evidence) best = fewer;
    }
  }
  return best;
}

/// A period or the place of a step tells people more than a curve that explains hardly more.
bool says_more(const Hypothesis& one, const Hypothesis& other, const Hypothesis& empty) {
  constexpr double hardly = 0.01;  // of what is explained
  const auto rank = [](const Hypothesis& h) {
    return !h.shapes.empty() && h.shapes.front().form->tells_a_place ? 1 : 0;
  };
  const double margin = hardly * std::max(0.0, std::max(one.evidence, other.evidence) - empty.evidence);
  const bool both_unnamed =
      !one.shapes.empty() && !other.shapes.empty() && one.terms.empty() && other.terms.empty();
  const double sign = both_unnamed ? rank(one) - rank(other) : 0;
  return one.evidence + sign * margin > other.evidence;
}

/// From the best of every form.
Hypothesis from_unnamed(Fitting& fitting, const Hypothesis& empty) {
  std::vector<Candidate> list = candidates(fitting, empty, {.named = false});
  std::set<const Form*> forms;
  std::erase_if(list, [&](const Candidate& s) { return !forms.insert(s.shape->form).second; });
  std::vector<Hypothesis> starts;
  for (const Candidate& candidate : list) starts.push_back(with(empty, candidate));
  fitting.fit_all(starts);
  Hypothesis best = empty;
  for (const Hypothesis& start : starts) {
    const Hypothesis other = climbed(fitting, start, {});
    if (says_more(other, best, empty)) best = other;
  }
  return best;
}

/// Whether only the coordinate of a term is certain, and a form is a function of that.
bool is_free_along(const Term& term, const Shape& shape) {
  return term.mechanism->any_curve && term.mechanism->coordinate == shape.coordinate;
}

/// Without one mechanism or unnamed function beside a term that bends freely instead; all of them.
std::vector<Hypothesis> bent_instead(const Hypothesis& h, std::size_t bending) {
  std::vector<Hypothesis> list;
  Hypothesis free = h;
  free.terms[bending].bends_freely = true;
  for (std::size_t t = 0; t < h.terms.size(); ++t) {
    if (t == bending) continue;
    list.push_back(free);
    list.back().terms.erase(list.back().terms.begin() + static_cast<std::ptrdiff_t>(t));
  }
  for (std::size_t s = 0; s < h.shapes.size(); ++s) {
    list.push_back(free);
    list.back().shapes.erase(list.back().shapes.begin() + static_cast<std::ptrdiff_t>(s));
  }
  return list;
}

/// What stands beside a mechanism of which only the coordinate is certain may be its own: then it bends more
/// freely than its formula was thought to.
Hypothesis with_own_curves(Fitting& fitting, const Hypothesis& h) {
  Hypothesis best = h;
  for (std::size_t t = 0; t < h.terms.size(); ++t) {
    if (!h.terms[t].mechanism->any_curve || h.terms[t].bends_freely) continue;
    std::vector<Hypothesis> bent = bent_instead(h, t);
    fitting.fit_all(bent);
    for (Hypothesis& own : bent)
      if (own.evidence > best.evidence - preference(own, best)) best = std::move(own);
  }
  return best;
}

/// Two mechanisms together may look like a third one: from those that explain a good part of what the best
/// one does, with one more.
Hypothesis from_parts(Fitting& fitting, const Hypothesis& empty, const Hypothesis& best) {
  constexpr double good_part = 0.3;
  constexpr std::size_t parts = 3, tries = 3;
  const double gain = best.evidence - empty.evidence;
  std::vector<Hypothesis> alone;
  for (const Candidate& part : candidates(fitting, empty, {.unnamed = false})) {
    if (alone.size() == parts || part.evidence < good_part * gain) break;
    if (!best.has(part.term)) alone.push_back(with(empty, part));
  }
  fitting.fit_all(alone);
  Hypothesis found = best;
  for (const Hypothesis& one : alone) {
    const auto two = with_one_more(fitting, one, {.tries = tries, .unnamed = false});
    if (two && two->evidence > found.evidence + odds::worth_a_move) found = *two;
  }
  return found.evidence > best.evidence ? climbed(fitting, found, {}) : best;
}

}  // namespace

Hypothesis climbed(Fitting& fitting, Hypothesis h, const Way& way) {
  constexpr int most_moves = 8;
  for (int move = 0; move < most_moves; ++move) {
    if (const std::optional<Hypothesis> more = with_one_more(fitting, h, way)) {
      h = with_own_curves(fitting, pruned(fitting, *more));
      continue;
    }
    if (!way.exchange || !fitting.has_patience()) break;
    const Hypothesis other = exchanged(fitting, h, way.tries);
    if (other.evidence <= h.evidence + 0.5) break;
    h = with_own_curves(fitting, pruned(fitting, other));
  }
  return h;
}

Hypothesis explored(Fitting& fitting, Hypothesis empty, const Progress& progress) {
  fitting.fit(empty);
  Hypothesis best = climbed(fitting, empty, {});
  report(progress, 0.4);
  if (best.terms.size() == 1 && best.shapes.empty() && fitting.has_patience())
    best = from_parts(fitting, empty, best);
  if (best.terms.size() + best.shapes.size() > 0 && fitting.has_patience()) {
    // Another way up: whatever is there may be one unnamed function instead of several mechanisms.
    const Hypothesis other = from_unnamed(fitting, empty);
    if (says_more(other, best, empty)) best = other;
  }
  if (!best.shapes.empty() && fitting.has_patience()) {
    // And one unnamed function may hide that several mechanisms explain more together.
    const Hypothesis other = climbed(fitting, empty, {.unnamed = false});
    if (other.evidence > best.evidence - preference(other, best)) best = other;
  }
  report(progress, 0.6);
  return best;
}

bool says_any_curve_of(const Term& term, const Shape& shape) {
  return is_free_along(term, shape) && !shape.form->tells_a_place;
}

double preference(const Hypothesis& named, const Hypothesis& unnamed) {
  double sum = 0;
  for (const Shape& shape : unnamed.shapes) {
    const bool same =
        std::ranges::any_of(named.terms, [&](const Term& term) { return is_free_along(term, shape); });
    if (shape.form->tells_a_place)
      sum += same ? 0 : odds::worth_a_name_beside_a_place;
    else
      sum += same ? 2 * odds::worth_a_name : odds::worth_a_name;
  }
  return sum;
}

void report(const Progress& progress, double share) {
  if (progress) progress(share, "comparing mechanisms");
}

}  // namespace fit::explain::search
