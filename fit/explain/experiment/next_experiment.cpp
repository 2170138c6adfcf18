// SPDX-License-Identifier: MIT
#include "fit/explain/experiment/next_experiment.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <span>

#include "fit/explain/experiment/planned.hpp"
#include "fit/explain/inference/apart.hpp"
#include "fit/explain/reduction/together.hpp"

namespace fit::explain {
namespace {

constexpr double worth_doing = 3;     // expected log odds below which an experiment separates nothing
constexpr double close_behind = 3.5;  // log odds within which suspects are not told apart

bool drifts(const Mechanism& mechanism) {
  return mechanism.coordinate == Coordinate::time || mechanism.coordinate == Coordinate::temperature;
}

/// Where a drift is suspected, an experiment says how warm the lidar is: a run that does not know when the
/// lidar was switched on would be compared at the wrong time.
void hold_steady(Experiment& e, const Explanation& explanation) {
  if (e.kind == Experiment::Kind::cold_start) return;
  e.steady = std::ranges::any_of(explanation.suspects, [](const Active& t) { return drifts(*t.mechanism); });
  if (!e.steady) return;
  for (CaptureInfo& c : e.captures)
    if (!c.temperature_c) c.temperature_c = steady_c;
}

/// A turning stage brings errors of its own, and echoes that are as weak as a bench can make them are lost by
/// every lidar: these are for suspects that show nowhere else.
bool worth_imagining(const Experiment& e, const Explanation& explanation) {
  if (e.kind == Experiment::Kind::dark) return !explanation.noise_suspects.empty();
  return e.kind != Experiment::Kind::turning ||
         std::ranges::any_of(explanation.suspects, [](const Active& term) {
           return term.mechanism->coordinate == Coordinate::stage_rate ||
                  term.mechanism->coordinate == Coordinate::range_rate;
         });
}

bool is_like(const CaptureInfo& a, const CaptureInfo& b, bool at_its_time) {
  const auto close = [](const std::optional<double>& x, const std::optional<double>& y, double within) {
    return x.has_value() == y.has_value() && (!x || std::abs(*x - *y) <= within);
  };
  return a.target == b.target && std::abs(a.stage_rad - b.stage_rad) < 0.02 * rad_per_deg &&
         std::abs(a.target_shift_mm - b.target_shift_mm) < 5 && close(a.reflectance, b.reflectance, 0.02) &&
         std::abs(a.stage_rate_rad_s - b.stage_rate_rad_s) < rad_per_deg &&
         close(a.temperature_c, b.temperature_c, 2) &&
         (!at_its_time || close(a.since_power_on_s, b.since_power_on_s, 60));
}

/// What was recorded already and decided nothing is not proposed again.
bool repeats(const Experiment& e, const std::vector<CaptureInfo>& so_far) {
  constexpr double mostly = 0.8;
  const auto known = std::ranges::count_if(e.captures, [&](const CaptureInfo& c) {
    return std::ranges::any_of(so_far, [&](const CaptureInfo& other) {
      return is_like(c, other, e.kind == Experiment::Kind::cold_start);
    });
  });
  return static_cast<double>(known) > mostly * static_cast<double>(e.captures.size());
}

/// What an experiment may find: a mechanism or an unnamed form, as it came out and as it may adjust, or
/// nothing.
struct Suspected {
  std::string id;
  std::function<Eigen::VectorXd(const MeanModel&)> effect_mm;
  std::function<Columns(const MeanModel&)> columns;
};

Suspected suspected(const Active& term) {
  return {term.mechanism->id, [&term](const MeanModel& model) { return effect_of(model, term); },
          [&term](const MeanModel& model) {
            TermColumns c = columns_of(model, term);
            c.sizes.prior.mean.setZero();
            c.sizes.prior.sigma *= 10;
            c.sizes.append(c.shapes);
            c.sizes.append(c.deviations);
            return c.sizes;
          }};
}

/// Where a step stands, or how long a period is, is held as it came out: promises are a little too good.
Suspected suspected(const SeenShape& seen) {
  return {unknown_physics, [&seen](const MeanModel& model) { return effect_of(model, seen); },
          [&seen](const MeanModel& model) {
            Columns c = columns_of(model, seen);
            c.prior.sigma *= 10;
            return c;
          }};
}

Suspected nothing() {
  return {nothing_missing,
          [](const MeanModel& model) -> Eigen::VectorXd { return Eigen::VectorXd::Zero(model.rows()); },
          [](const MeanModel&) { return Columns(); }};
}

/// Every suspect once, whatever the number of sets it is in.
std::vector<Suspected> suspects_of(const Explanation& explanation) {
  std::vector<const Active*> terms;
  for (const Active& term : explanation.suspects)
    if (std::ranges::none_of(terms, [&](const Active* other) {
          return other->mechanism == term.mechanism && other->target == term.target;
        }))
      terms.push_back(&term);
  std::vector<Suspected> list;
  for (const Active* term : terms) list.push_back(suspected(*term));
  for (const SeenShape& shape : explanation.unnamed_suspects) list.push_back(suspected(shape));
  if (explanation.may_be_nothing) list.push_back(nothing());
  return list;
}

/// Evidence that the effect of one (row) leaves when another (column) tries to take it up.
Eigen::MatrixXd evidence_between(const Reduced& all, const std::vector<Suspected>& suspects) {
  constexpr std::size_t enough = 12000;
  const std::optional<Reduced> few =
      all.cells.size() > enough ? std::optional(merged(all, enough)) : std::nullopt;
  MeanModel model(few ? *few : all, {});
  const auto samples_of = [](const Reduced& reduced) {
    double sum = 1;
    for (const Cell& cell : reduced.cells)
      if (cell.usable) sum += cell.n;
    return sum;
  };
  const double share = few ? samples_of(all) / samples_of(*few) : 1;
  const auto count = static_cast<Eigen::Index>(suspects.size());
  Eigen::MatrixXd evidence = Eigen::MatrixXd::Zero(count, count);
  for (Eigen::Index rival = 0; rival < count; ++rival) {
    Columns base = nuisance_columns(model, Nuisance(all.bench));
    base.append(suspects[static_cast<std::size_t>(rival)].columns(model));
    model.set_base(base.columns, {Eigen::VectorXd::Zero(base.columns.cols()), base.prior.sigma});
    for (Eigen::Index truth = 0; truth < count; ++truth) {
      if (truth == rival) continue;
      const Eigen::VectorXd left =
          model.remainder(suspects[static_cast<std::size_t>(truth)].effect_mm(model));
      double sum = 0;
      for (Eigen::Index i = 0; i < model.rows(); ++i) sum += std::pow(left[i] / model.sigma_of_mean(i), 2);
      evidence(truth, rival) = share * sum / 2;
    }
  }
  return evidence;
}

/// Adds what an experiment tells about suspects that lie so far apart (log odds).
void judge(Experiment& e, const Eigen::MatrixXd& apart, const std::vector<std::string>& ids) {
  const Eigen::Index count = apart.rows();
  std::vector<bool> taken(ids.size(), false);
  for (Eigen::Index first = 0; first < count; ++first) {
    double doubt = 1;  // what the others keep beside a probability of 1
    for (Eigen::Index other = 0; other < count; ++other)
      if (other != first) doubt += std::exp(-apart(first, other));
    e.information += std::log(static_cast<double>(count) / doubt) / static_cast<double>(count);
    if (taken[static_cast<std::size_t>(first)]) continue;
    std::vector<Eigen::Index> group = {first};
    taken[static_cast<std::size_t>(first)] = true;
    for (std::size_t i = 0; i < group.size(); ++i)
      for (Eigen::Index other = 0; other < count; ++other)
        if (!taken[static_cast<std::size_t>(other)] && apart(group[i], other) <= worth_doing) {
          taken[static_cast<std::size_t>(other)] = true;
          group.push_back(other);
        }
    e.groups.emplace_back();
    for (const Eigen::Index member : group) e.groups.back().push_back(ids[static_cast<std::size_t>(member)]);
  }
  for (Eigen::Index i = 0; i < count; ++i)
    for (Eigen::Index j = 0; j < i; ++j)
      if (apart(i, j) > worth_doing) e.expected = std::min(e.expected, apart(i, j));
}

bool better(const Experiment& a, const Experiment& b) {
  constexpr double same_information = 0.05, same_odds = 1, beyond_doubt = 4.6;  // a hundred to one
  if (std::abs(a.information - b.information) > same_information) return a.information > b.information;
  const double odds_a = std::min(a.expected, beyond_doubt), odds_b = std::min(b.expected, beyond_doubt);
  if (std::abs(odds_a - odds_b) > same_odds) return odds_a > odds_b;
  return work_s(a) < work_s(b);
}

Reduced pooled(Reduced all) {
  pool_variances(all);
  return all;
}

/// One more recording, as if so many times its scans had been made: the same statistics, of more samples.
void add(const Recording& more, int times, Reduced& all, const Standing& standing = {}) {
  const std::size_t cells = all.cells.size(), groups = all.groups.size();
  reduce_into(all, more, {}, standing);
  for (Cell& cell : std::span(all.cells).subspan(cells)) cell.n *= times;
  for (Group& group : std::span(all.groups).subspan(groups)) {
    group.scans *= times;
    for (double& sum : group.lagged) sum *= times;
    group.lagged_squares *= times;
    group.pairs *= times;
  }
}

/// Before one bench that holds the targets of all; the last one's scans count so many times.
Reduced reduced_together(const std::vector<const Recording*>& list, int times = 1) {
  const Together together(list);
  Reduced all;
  for (std::size_t i = 0; i < list.size(); ++i)
    add(*together.recordings()[i], i + 1 == list.size() ? times : 1, all, together.standing(i));
  return all;
}

/// Suspects of one kind: what recordings are worth between them.
class Rivalry {
 public:
  using Evidence = std::function<Eigen::MatrixXd(const Reduced&)>;

  Rivalry(std::vector<std::string> ids, Evidence evidence, const Reduced& so_far)
      : ids_(std::move(ids)), evidence_(std::move(evidence)) {
    // They could not be told apart so far. If what is recorded should have told them apart all the same,
    // their formulas can bend more than the small changes that are imagined, and promises are cut down by as
    // much.
    believed_ = between(so_far).unaryExpr(
        [](double apart) { return apart > close_behind ? close_behind / apart : 1.0; });
  }
  void judge(Experiment& e, const Reduced& all) const {
    explain::judge(e, between(all).cwiseProduct(believed_), ids_);
  }

 private:
  /// Whichever of two is true.
  [[nodiscard]] Eigen::MatrixXd between(const Reduced& all) const {
    Eigen::MatrixXd evidence = evidence_(all);
    // Nothing leaves no traces; that it is true shows where those of the other are missing.
    if (ids_.back() == nothing_missing)
      evidence.bottomRows(1) = Eigen::MatrixXd(evidence.rightCols(1).transpose());
    return evidence.cwiseMin(evidence.transpose());
  }
  std::vector<std::string> ids_;
  Evidence evidence_;
  Eigen::MatrixXd believed_;
};

std::vector<Rivalry> rivalries_of(const Explanation& explanation, const Reduced& so_far) {
  std::vector<Rivalry> list;
  std::vector<std::string> ids;
  if (explanation.rivals_in_range() > 1) {
    const std::vector<Suspected> suspects = suspects_of(explanation);
    for (const Suspected& suspect : suspects) ids.push_back(suspect.id);
    list.emplace_back(
        ids, [suspects](const Reduced& all) { return evidence_between(all, suspects); }, so_far);
  }
  if (explanation.rivals_beside_range() > 1) {
    ids.clear();
    for (const Suspect& suspect : explanation.noise_suspects) ids.push_back(suspect.mechanism->id);
    if (explanation.may_be_nothing) ids.emplace_back(nothing_missing);
    list.emplace_back(
        ids,
        [&explanation](const Reduced& all) {
          return inference::evidence_between(all, explanation.noise_suspects, explanation.may_be_nothing);
        },
        so_far);
  }
  return list;
}

/// Fills in what an experiment would tell beside what is recorded; false if it tells nobody apart.
bool judge(Experiment& e, const Reduced& all, const std::vector<Rivalry>& rivalries) {
  e.information = 0;
  e.expected = 1e300;
  e.groups.clear();
  for (const Rivalry& rivalry : rivalries) rivalry.judge(e, all);
  return e.expected < 1e300;
}

/// What is recorded so far, and how another recording would join it.
struct Recorded {
  const Bench& bench;
  std::vector<CaptureInfo> captures;
  double sigma_mm;  ///< Of one sample.
  std::vector<Rivalry> rivalries;
  std::function<Reduced(const Recording& more, int times)> with;  ///< Its scans made so many times.
};

/// Those of these that tell any suspects apart beside what is recorded.
std::vector<Experiment> telling(const std::vector<Experiment>& possible, const Explanation& explanation,
                                const Recorded& recorded) {
  std::vector<Experiment> list;
  // What is too weak for a few scans may show in many.
  for (const int times : {1, 10}) {
    for (Experiment e : possible) {
      if (!worth_imagining(e, explanation)) continue;
      hold_steady(e, explanation);
      if (times == 1 && repeats(e, recorded.captures)) continue;
      const Planned imagined(recorded.bench, e.captures, law_of_bench(explanation.bench), e.scans,
                             recorded.sigma_mm);
      const bool separates = judge(e, recorded.with(imagined, times), recorded.rivalries);
      e.scans *= times;
      if (separates) list.push_back(std::move(e));
    }
    if (!list.empty()) return list;
  }
  return list;
}

std::vector<Experiment> telling_with_stage(const std::vector<const Recording*>& recordings,
                                           const Explanation& explanation, const StageTravel& travel) {
  if (!explanation.has_rivals() || recordings.empty()) return {};
  const Reduced so_far = reduced_together(recordings);
  if (so_far.groups.empty()) return {};
  const auto with = [&so_far](const Recording& more, int times) {
    Reduced all = so_far;
    add(more, times, all);
    return pooled(std::move(all));
  };
  return telling(possible_experiments(so_far.bench, travel), explanation,
                 {so_far.bench, so_far.captures, so_far.typical_sigma_mm(),
                  rivalries_of(explanation, pooled(so_far)), with});
}

std::vector<Experiment> telling_by_hand(const std::vector<const Recording*>& recordings,
                                        const Explanation& explanation) {
  if (!explanation.has_rivals() || recordings.empty() || recordings.front()->bench().targets.empty())
    return {};
  const Bench& bench = recordings.front()->bench();
  std::vector<CaptureInfo> captures;
  for (const Recording* recording : recordings)
    captures.insert(captures.end(), recording->captures().begin(), recording->captures().end());
  const auto with = [&recordings](const Recording& more, int times) {
    std::vector<const Recording*> list = recordings;
    list.push_back(&more);
    return pooled(reduced_together(list, times));
  };
  return telling(experiments_by_hand(bench, recordings), explanation,
                 {bench, captures, reduce(*recordings.front(), {}).typical_sigma_mm(),
                  rivalries_of(explanation, pooled(reduced_together(recordings))), with});
}

}  // namespace

std::vector<Experiment> telling_experiments(const std::vector<const Recording*>& recordings,
                                            const Explanation& explanation, const StageTravel& travel) {
  return explanation.several_places ? telling_by_hand(recordings, explanation)
                                    : telling_with_stage(recordings, explanation, travel);
}

std::optional<Experiment> best_experiment(const std::vector<const Recording*>& recordings,
                                          const Explanation& explanation, const StageTravel& travel) {
  std::optional<Experiment> best;
  for (const Experiment& e : telling_experiments(recordings, explanation, travel))
    if (!best || better(e, *best)) best = e;
  return best;
}

}  // namespace fit::explain
