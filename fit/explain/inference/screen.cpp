// SPDX-License-Identifier: MIT
#include "fit/explain/inference/screen.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>
#include <numeric>
#include <optional>

#include "fit/explain/inference/approximation.hpp"
#include "fit/explain/inference/peak.hpp"
#include "fit/explain/inference/two_cores.hpp"
#include "fit/explain/model/combs.hpp"
#include "fit/explain/model/spans.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain::inference {
namespace {

using Eigen::Index;

/// Asks what one kind would add, at all its starts and between the best of them.
class ScoreTest : Approximation {
 public:
  using Approximation::Approximation;

  /// On the grid of its starts.
  void test_starts() {
    std::vector<Term> terms;
    for (const auto& start : kind_->bins ? proposed() : kind_->starts) terms.push_back(term_at(start));
    std::vector<double> logs;
    if (kind_->bins)
      for (Term& term : terms) logs.push_back(with_sizes(term));
    else
      logs = with_sizes_at_starts(terms);
    const bool whole = !kind_->refines && !is_form();
    if (whole) add_deviations(terms, logs);
    for (std::size_t i = 0; i < terms.size(); ++i) {
      const double penalty = penalty_of(terms[i]);
      logs[i] -= penalty;
      tested_.push_back({logs[i], std::move(terms[i]), penalty});
    }
    if (kind_->mechanism->any_curve) keep_places();
    const double places = kind_->bins ? combs() : static_cast<double>(logs.size());
    over_grid_ = log_sum(logs) - std::log(places);
    if (whole)
      std::ranges::sort(tested_, std::greater<>(), &Tested::log_evidence);
    else
      keep_modes();
    if (is_form() && kind_->form->form->from_to) add_places();
    if (kind_->begins) add_spans();
    if (kind_->threshold) add_thresholds();
    best_.term = tested_.front().term;
    best_.term.by_grid = over_grid_ - tested_.front().log_evidence - tested_.front().penalty;
    best_.log_evidence = over_grid_;
  }

  /// Between its starts, with what its formula leaves open.
  void refine_best() {
    const bool refines = !model::refined_shapes_of(*kind_).empty();
    const double first = tested_.front().log_evidence;
    std::vector<double> modes;
    std::map<double, double> firsts;  // of each choice: between starts the other may be the better one
    double most = -1e300, peak = -1e300, penalty = 0;
    for (const Tested& one : tested_) {
      const double first_of_it = firsts.try_emplace(choice_of(one.term), one.log_evidence).first->second;
      if (kind_->refines && one.log_evidence < first_of_it - another_mode) continue;
      const Term there = refines ? refined(one.term) : one.term;
      const double known = kind_->refines ? with_everything(there, false) : one.log_evidence + one.penalty;
      modes.push_back(known + (refines ? width_at(there, known) : 0) - one.penalty);
      if (modes.back() <= most) continue;
      most = modes.back();
      peak = known;
      penalty = one.penalty;
      best_.term = there;
    }
    // A formula that may bend at will says little of where it is: with its bends another start may be better.
    std::vector<double> bent;
    for (const Tested& one : places_) {
      const double known = bent.emplace_back(with_everything(one.term, false));
      if (known <= most) continue;  // a width only takes off
      const double with_width = known + width_at(one.term, known);
      if (with_width <= most) continue;
      modes.push_back(most = with_width);
      peak = known;
      penalty = one.penalty;
      best_.term = one.term;
    }
    if (best_.always && refines) best_.always = refined(*best_.always);
    double all = log_sum(modes);
    if (!kind_->refines) all -= std::log(static_cast<double>(kind_->starts.size()));
    const bool grid_says = refines && !kind_->bins;
    const double by_grid =
        bent.empty() ? over_grid_ - first
                     : log_sum(bent) - std::log(static_cast<double>(bent.size())) - std::ranges::max(bent);
    best_.term.by_grid = grid_says ? by_grid - tested_.front().penalty : 1e300;
    best_.term.by_modes = all - most - penalty;
    best_.log_evidence = std::min(all, peak + best_.term.by_grid);
  }

  /// A form's place and extent between those of its list.
  void refine_places() {
    if (kind_->form->form->whole_places) return;
    const Tested listed = tested_.front();
    const std::size_t extent = listed.term.values.size() - 1;
    Term there = listed.term;
    const auto log_evidence = [&](const std::vector<double>& values) {
      there.values = values;
      return with_sizes(there);
    };
    const std::vector<std::size_t> both{extent - 1, extent};
    Peak peak = peak_between(kind_->starts, both, {listed.term.values, listed.log_evidence}, log_evidence);
    double places = static_cast<double>(kind_->starts.size());
    if (kind_->form->form->from_to) {
      const std::vector<double> borders = model::places_between(recorded_places(), 100000);
      peak = peak_among(borders, both, peak, log_evidence);
      places = static_cast<double>(borders.size() * (borders.size() + 1)) / 2;
    }
    if (peak.log_evidence <= listed.log_evidence) return;
    best_.term = listed.term;
    best_.term.values = peak.values;
    const double most = with_sizes(best_.term);
    over_grid_ = log_sum({over_grid_, most + peak.log_share - std::log(places)});
    best_.term.by_grid = over_grid_ - most;
    best_.log_evidence = over_grid_;
  }

  /// The most that it may come to: where a peak is narrow, the grid's mean says little.
  [[nodiscard]] double upper_bound() const { return tested_.front().log_evidence + kind_->log_prior; }
  [[nodiscard]] bool is_form() const { return kind_->is_form(); }
  [[nodiscard]] const Candidate& answer() const { return best_; }

 private:
  static constexpr std::size_t modes_refined = 2;
  static constexpr double another_mode = 8;

  struct Tested {
    double log_evidence;
    Term term;
    double penalty = 0;  ///< Minus the log of the prior probability of its times and its choice.
  };

  /// Of two things that a recording may not tell apart one is the usual one.
  [[nodiscard]] double choice_of(const Term& term) const {
    return kind_->choice ? term.values[*kind_->choice] : 0;
  }
  [[nodiscard]] double penalty_of(const Term& term) const {
    return (choice_of(term) > 0 ? numbers::fits_as_well : 0) + penalty_of_gear(term);
  }
  /// Half of what gears make has the longest period, a whole turn, and the other half any other.
  [[nodiscard]] double penalty_of_gear(const Term& term) const {
    const auto gear = kind_->mechanism->parameter_of(Parameter::Scale::gear);
    if (!gear) return 0;
    const Parameter& period = kind_->mechanism->parameters[*gear];
    const auto periods = static_cast<double>(kind_->starts.size());
    const bool is_longest = term.values[*gear] > 0.999 * period.upper;
    return std::log(2 * (is_longest ? 1 : periods - 1) / periods);
  }
  /// Of whole numbers and moments, with what the formula leaves open: harmonics may be the larger part of the
  /// effect.
  void add_deviations(const std::vector<Term>& terms, std::vector<double>& logs) const {
    constexpr std::size_t most = 8;
    std::vector<std::size_t> best(logs.size());
    std::iota(best.begin(), best.end(), 0);
    std::ranges::sort(best, std::greater<>(), [&](std::size_t i) { return logs[i]; });
    if (best.size() > most) best.resize(most);
    for (const std::size_t i : best) logs[i] = with_everything(terms[i], false);
  }

  /// The best of each choice.
  void keep_modes() {
    std::ranges::sort(tested_, std::greater<>(), &Tested::log_evidence);
    std::map<double, std::size_t> kept;
    std::erase_if(tested_, [&](const Tested& one) { return ++kept[choice_of(one.term)] > modes_refined; });
  }

  /// What the shapes' width takes off the evidence with everything else.
  [[nodiscard]] double width_at(const Term& term, double known) const {
    return std::min(0.0, with_everything(term, true) - known);
  }

  /// The best start at every place of the first shape.
  void keep_places() {
    const std::vector<std::size_t> shapes = model::refined_shapes_of(*kind_);
    if (shapes.empty()) return;
    std::map<double, const Tested*> best;
    for (const Tested& one : tested_) {
      const Tested*& there = best[one.term.values[shapes.front()]];
      if (!there || one.log_evidence > there->log_evidence) there = &one;
    }
    for (const auto& [place, one] : best) places_.push_back(*one);
  }

  /// Half of the prior is for always, if that may be, the other for all spans of time alike.
  void add_spans() {
    const bool may_be_always = !kind_->mechanism->only_for_a_while;
    const double half = may_be_always ? std::log(2.0) : 0;
    for (Tested& one : tested_)
      one = {may_be_always ? one.log_evidence - half : -1e300, std::move(one.term), one.penalty + half};
    std::vector<double> logs{may_be_always ? over_grid_ - half : -1e300};
    const double places = std::log(static_cast<double>(kind_->starts.size()));
    const bool either_sign = std::ranges::any_of(kind_->coefficients, [&](const auto& c) {
      return kind_->mechanism->parameters[c.parameter].sign == 0;
    });
    for (const Tested& always : std::vector(tested_)) {
      const model::Spans spans = model::spans_in(
          scores_along(Coordinate::time,
                       [&](const ChannelRows& rows) { return effect_of_typical(rows, always.term); }),
          either_sign);
      const double penalty =
          always.penalty + std::log(std::max<double>(1, static_cast<double>(spans.possible)));
      for (const model::Span& span : spans.likeliest) {
        Tested within{0, always.term, penalty};
        within.term.values[*kind_->begins] = span.from;
        within.term.values[*kind_->begins + 1] = span.to;
        within.log_evidence = with_sizes(within.term) - penalty;
        logs.push_back(within.log_evidence - places);
        tested_.push_back(std::move(within));
      }
    }
    over_grid_ = log_sum(logs);
    const Term always = tested_.front().term;
    keep_modes();
    if (may_be_always && tested_.front().term.values[*kind_->begins] != always.values[*kind_->begins])
      best_.always = always;
  }

  /// Between which the rows' own residuals say that it acts.
  void add_places() {
    constexpr std::size_t most_places = 200;
    const std::size_t from = kind_->starts.front().size() - 2;
    const model::Spans spans = model::spans_in(scores_alone(), true, most_places);
    double highest = -1e300;
    for (const model::Span& span : spans.likeliest) {
      Tested within{0, term_at(kind_->starts.front())};
      within.term.values[from] = span.from;
      within.term.values[from + 1] = span.to;
      within.log_evidence = with_sizes(within.term);
      highest = std::max(highest, within.log_evidence);
      tested_.push_back(std::move(within));
    }
    if (spans.possible > 0)
      over_grid_ = log_sum({over_grid_, highest - std::log(static_cast<double>(spans.possible))});
    keep_modes();
  }

  /// With sizes as the catalogue has them.
  [[nodiscard]] Eigen::VectorXd effect_of_typical(const ChannelRows& rows, const Term& term) const {
    std::vector<double> values = term.values;
    for (const model::Coefficient& c : kind_->coefficients)
      values[c.parameter] = kind_->mechanism->parameters[c.parameter].typical;
    return model::effect_of(rows, *kind_, values);
  }

  /// Thresholds at which the most would happen, each with every other shape of the grid.
  void add_thresholds() {
    const std::size_t k = *kind_->threshold;
    const auto all = [&](const ChannelRows& rows) {  // as if every row were below
      std::vector<double> values = kind_->starts.front();
      values[k] = kind_->mechanism->parameters[k].upper;
      return model::effect_of(rows, *kind_, values);
    };
    const double best_of_grid = tested_.front().term.values[k];
    std::vector<Tested> more;
    for (const double threshold : model::thresholds_in(scores_along(kind_->mechanism->coordinate, all)))
      for (const auto& start : kind_->starts) {
        if (start[k] != best_of_grid) continue;
        Tested one{0, term_at(start), 0};
        one.term.values[k] = threshold;
        one.log_evidence = with_sizes(one.term);
        more.push_back(std::move(one));
      }
    if (more.empty()) return;
    // A peak between the starts is no wider than the distance from one to the next.
    const double highest = std::ranges::max(more, {}, &Tested::log_evidence).log_evidence;
    over_grid_ = log_sum({over_grid_, highest - std::log(static_cast<double>(kind_->starts.size()))});
    std::ranges::move(more, std::back_inserter(tested_));
    keep_modes();
  }

  /// Where a comb may be, by the first channel in which it acts.
  [[nodiscard]] std::vector<std::vector<double>> proposed() const {
    std::size_t c = 0;
    while (!kind_->acts_in[c]) ++c;
    const ChannelRows& rows = *session_->channels()[c];
    const Eigen::VectorXd score = rows.score(around_->eta[c]);
    std::vector<model::RowScore> scores;
    for (Index i = 0; i < rows.rows(); ++i)
      scores.push_back({model::coordinate_of(kind_->mechanism->coordinate, rows.at(i)), score[i], 0});
    std::vector<std::vector<double>> starts;
    const std::size_t bin = *kind_->bins, zero = bin + 1;
    for (const model::Comb& comb :
         model::combs_in(scores, kind_->mechanism->parameters[bin], !kind_->is_plain)) {
      starts.push_back(kind_->starts.front());
      starts.back()[bin] = comb.bin;
      starts.back()[zero] = comb.zero;
    }
    return starts.empty() ? kind_->starts : starts;
  }

  /// As many as can be told apart.
  [[nodiscard]] double combs() const {
    const auto& parameters = kind_->mechanism->parameters;
    return parameters[*kind_->bins].starts *
           static_cast<double>(kind_->is_plain ? 1 : parameters[*kind_->bins + 1].starts);
  }

  [[nodiscard]] Term term_at(const std::vector<double>& values) const {
    Term term;
    term.kind = kind_;
    term.values = values;
    return term;
  }

  /// Shapes between those of the grid.
  [[nodiscard]] Term refined(const Term& start) const {
    const std::vector<std::size_t> shapes = model::refined_shapes_of(*kind_);
    const auto& parameters = kind_->mechanism->parameters;
    std::vector<Free> free;
    for (const std::size_t k : shapes) {
      const Parameter& p = parameters[k];
      const auto in = [&](double v) { return p.logarithmic ? std::log(v) : v; };
      const double lower = in(p.lower), upper = in(p.upper);
      free.push_back({std::clamp(in(start.values[k]), lower, upper), lower, upper,
                      (upper - lower) / std::max(2, p.starts) / 2});
    }
    Term at = start, best = start;
    double most = -1e300;
    climb(free, with_sizes(at), [&](const double* x) {
      for (std::size_t j = 0; j < shapes.size(); ++j)
        at.values[shapes[j]] = parameters[shapes[j]].logarithmic ? std::exp(x[j]) : x[j];
      const double log_evidence = with_sizes(at);
      if (log_evidence > most) {
        most = log_evidence;
        best = at;
      }
      return log_evidence;
    });
    return best;
  }

  std::vector<Tested> tested_;  ///< The best of the grid.
  std::vector<Tested>
      places_;  ///< Where the formula bends at will: the best at every place of its first shape.
  double over_grid_ = -1e300;
  Candidate best_;
};

}  // namespace

std::vector<Candidate> screen(const Session& session, const Fitted& fitted, const Kind* but,
                              bool at_other_places, const Optimum* around) {
  std::optional<Optimum> own;
  if (!around) around = &own.emplace(expanded_for_new_terms(session, fitted.design, fitted.optimum));
  const auto is_there = [&](const Kind& kind) {
    if (at_other_places && kind.mechanism->parameter_of(Parameter::Scale::width)) return false;
    return std::ranges::any_of(fitted.hypothesis.terms,
                               [&](const Term& term) { return term.kind->is_same_cause(kind); });
  };
  std::vector<const Kind*> asked;
  for (const Kind& kind : session.kinds())
    if (&kind != but && !is_there(kind)) asked.push_back(&kind);
  std::ranges::stable_sort(asked, std::greater<>(), [](const Kind* kind) { return kind->starts.size(); });
  std::vector<ScoreTest> tests;
  for (const Kind* kind : asked) tests.emplace_back(session, fitted, *around, *kind);
  on_two_cores(tests.size(), [&](std::size_t i) { tests[i].test_starts(); });
  std::ranges::sort(tests, std::greater<>(), &ScoreTest::upper_bound);
  std::vector<ScoreTest*> promising;
  std::size_t names = 2 * numbers::tries, forms = numbers::tries;
  for (ScoreTest& test : tests) {
    std::size_t& left = test.is_form() ? forms : names;
    if (left == 0) continue;
    --left;
    promising.push_back(&test);
  }
  on_two_cores(promising.size(), [&](std::size_t i) {
    promising[i]->is_form() ? promising[i]->refine_places() : promising[i]->refine_best();
  });
  std::vector<Candidate> list;
  for (const ScoreTest& test : tests) list.push_back(test.answer());
  std::ranges::sort(list, std::greater<>(), &Candidate::log_posterior);
  return list;
}

}  // namespace fit::explain::inference
