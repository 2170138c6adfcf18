// SPDX-License-Identifier: MIT
#include "fit/explain/answer/twin.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "fit/bench/radiometer.hpp"
#include "fit/explain/inference/runs.hpp"

namespace fit::explain {
namespace {

constexpr const char* wide_beam = "mixed-pixel";

using Eigen::VectorXd;

constexpr std::size_t places_of_twin = 150,
                      places_of_function = 60;  // of one that is to hold for other recordings
constexpr double worth_a_table_mm = 0.02;  // root mean square of what it does
constexpr int most_tables = 4;
constexpr double worth_a_table_share = 0.2;  // share of an effect's squares that one more table must tell

/// An effect on the means as a table along one coordinate.
struct Along {
  std::string coordinate;
  Channel channel = Channel::range;
  std::string target;
  VectorXd at;  ///< The coordinate, row by row; NaN where it does not act.
};

double corner_of(const Cell& cell) { return cell.at.corner_mm; }
double place_of(const Cell& cell) { return cell.at.along_mm; }

Along along(const MeanModel& model, Coordinate coordinate, Channel channel) {
  Along a{name_of(coordinate), channel, "", VectorXd(model.rows())};
  for (Eigen::Index i = 0; i < model.rows(); ++i) a.at[i] = coordinate_at(model, coordinate, i);
  return a;
}

Along along(const MeanModel& model, const std::string& name, double (*of)(const Cell&), int target) {
  Along a{name, Channel::range, "", VectorXd(model.rows())};
  if (target >= 0) a.target = model.bench().target_at(target).name;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const Cell& cell = model.cell(i);
    a.at[i] = target < 0 || cell.at.target == target ? of(cell) : std::nan("");
  }
  return a;
}

/// Where and by which way a mechanism works; empty where no single coordinate tells it.
std::optional<Along> along(const MeanModel& model, const Active& term) {
  if (term.target >= 0) return along(model, "along_mm", place_of, term.target);
  switch (term.mechanism->coordinate) {
    case Coordinate::target:
      return along(model, "corner_mm", corner_of, -1);
    case Coordinate::beam:
    case Coordinate::stage:
    case Coordinate::range:
    case Coordinate::intensity:
    case Coordinate::incidence:
    case Coordinate::time:
    case Coordinate::temperature:
      break;
    default:
      return {};
  }
  double range = 0, beam = 0, stage = 0;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const Effect e = term.mechanism->act(model.cell(i).at, term.values);
    if (e.origin_mm.squaredNorm() > 0) return {};
    range += std::abs(e.range_mm);
    beam += std::abs(e.beam_rad);
    stage += std::abs(e.stage_rad);
  }
  if ((range > 0) + (beam > 0) + (stage > 0) != 1) return {};
  return along(model, term.mechanism->coordinate,
               range > 0  ? Channel::range
               : beam > 0 ? Channel::beam_angle
                          : Channel::stage_angle);
}

/// Every coordinate and every way along which an effect without a name may be told.
std::vector<Along> all_ways(const MeanModel& model) {
  std::vector<Along> list;
  for (const Coordinate c : {Coordinate::range, Coordinate::intensity, Coordinate::beam, Coordinate::stage,
                             Coordinate::incidence, Coordinate::time, Coordinate::temperature})
    list.push_back(along(model, c, Channel::range));
  for (const Coordinate c : {Coordinate::beam, Coordinate::time})
    list.push_back(along(model, c, Channel::range_scale));
  list.push_back(along(model, Coordinate::beam, Channel::beam_angle));
  list.push_back(along(model, Coordinate::stage, Channel::stage_angle));
  list.push_back(along(model, "corner_mm", corner_of, -1));
  for (std::size_t t = 0; t < model.bench().targets.size() && t < 12; ++t)
    list.push_back(along(model, "along_mm", place_of, static_cast<int>(t)));
  return list;
}

/// Table of an effect (mm, row by row); empty when it is not worth one.
EmpiricalFunction table_of(const MeanModel& model, const VectorXd& effect_mm, const Along& a,
                           std::size_t places = places_of_twin) {
  const ChannelInWords& channel = in_words_of(a.channel);
  EmpiricalFunction table{a.coordinate, channel.key, a.target, {}, {}};
  std::vector<WeighedValue> list;
  double squares = 0, count = 0;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    if (!std::isfinite(a.at[i])) continue;
    const double sensitivity = sensitivity_of(a.channel, model.cell(i).sight);
    if (sensitivity != 0)
      list.push_back({a.at[i], channel.in_unit * effect_mm[i] / sensitivity, sensitivity * sensitivity});
    squares += effect_mm[i] * effect_mm[i];
    count += 1;
  }
  if (list.empty() || count < 4 || squares < worth_a_table_mm * worth_a_table_mm * count) return table;
  const auto [first, last] = std::ranges::minmax(list, {}, &WeighedValue::at);
  const std::size_t each = list.size() / places;
  RunMeans means = means_over_runs(std::move(list), each);
  if (means.at.size() < 2) return table;
  table.at = std::move(means.at);
  table.value = std::move(means.value);
  table.at.front() = first.at;  // the outermost runs hold to the ends of what was recorded
  table.at.back() = last.at;
  return table;
}

VectorXd explained_by(const MeanModel& model, const EmpiricalFunction& table, const Along& a) {
  VectorXd explained = VectorXd::Zero(model.rows());
  const double in_unit = in_words_of(a.channel).in_unit;
  for (Eigen::Index i = 0; i < model.rows(); ++i)
    if (std::isfinite(a.at[i]))
      explained[i] = table.value_at(a.at[i]) / in_unit * sensitivity_of(a.channel, model.cell(i).sight);
  return explained;
}

/// An effect of any kind, as tables that add up to it, the one that tells most of it first.
void tabulate(const MeanModel& model, VectorXd effect_mm, Bench& bench) {
  const std::vector<Along> ways = all_ways(model);
  for (int count = 0; count < most_tables; ++count) {
    double least = effect_mm.squaredNorm() * (1 - worth_a_table_share);
    EmpiricalFunction best;
    VectorXd rest;
    for (const Along& a : ways) {
      const EmpiricalFunction table = table_of(model, effect_mm, a);
      const VectorXd left = effect_mm - explained_by(model, table, a);
      if (left.squaredNorm() >= least) continue;
      least = left.squaredNorm();
      best = table;
      rest = left;
    }
    if (best.at.empty()) return;
    add_empirical(bench, best);
    effect_mm = rest;
  }
}

/// The bench states placements, sizes and shapes as they were found: only how causes bend, and what has no
/// name, is left to be told.
void hold_what_is_stated(Base& base) {
  constexpr double hardly_free = 1e-6;
  const auto hold = [&](Eigen::Index first, Eigen::Index count) {
    base.all.prior.mean.segment(first, count).setZero();
    base.all.prior.sigma.segment(first, count).setConstant(hardly_free);
  };
  hold(0, base.term_first.empty() ? base.shape_first.front() : base.term_first.front());
  for (std::size_t t = 0; t < base.term_first.size(); ++t) hold(base.term_first[t], base.term_count[t]);
}

constexpr const char* outliers = "outliers";

/// Where samples lie that have nothing to do with the target: dust before it, or a ghost at its own range.
void describe_strays(const Reduced& reduced, Bench& bench) {
  if (!bench.knows(outliers) || described_strays(bench) || reduced.strays_mm.size() < 20) return;
  StrayPlaces strays;
  std::vector<float> list = reduced.strays_of_target;
  std::ranges::sort(list);
  // Dust is met before the target, at any share of the way.
  strays.before_target = list[list.size() * 98 / 100] < 1;
  if (!strays.before_target) {
    list = reduced.strays_mm;
    std::ranges::sort(list);
  }
  constexpr std::size_t parts = 40;
  for (std::size_t q = 0; q <= parts; ++q)
    strays.quantiles.push_back(static_cast<double>(list[q * (list.size() - 1) / parts]));
  state_strays(bench, strays);
}

}  // namespace

std::vector<EmpiricalFunction> complete_twin(Reduced& reduced, const MeanResult& means, Explanation& out) {
  predict_at(reduced, means.best);
  const Reduced rows = merged(reduced, rows_for_tables);
  MeanModel model(rows, means.noise);
  Base base = base_columns(model, means.best);
  hold_what_is_stated(base);
  model.set_base(base.all.columns, base.all.prior);
  const VectorXd x = model.posterior_mean();
  const auto named = [&](const Active& term) {
    return std::ranges::any_of(out.mechanisms, [&](const Found& f) {
      return f.mechanism == term.mechanism.get() &&
             (term.target < 0 || f.target == reduced.bench.target_at(term.target).name);
    });
  };
  for (std::size_t t = 0; t < means.best.terms.size(); ++t) {
    const Active& term = means.best.terms[t];
    // How this device's cause bends away from the formula: what the fit allowed for.
    const VectorXd bent = bend_of(base, x, t);
    if (!named(term))
      tabulate(model, effect_of(model, term) + bent, out.bench);
    else if (const auto a = along(model, term))
      add_empirical(out.bench, table_of(model, bent, *a));
  }
  std::vector<EmpiricalFunction> functions;
  for (std::size_t s = 0; s < means.best.shapes.size(); ++s) {
    const Eigen::Index from = base.shape_first[s], count = base.shape_first[s + 1] - from;
    const VectorXd effect = base.all.columns.middleCols(from, count) * x.segment(from, count);
    const Shape& shape = means.best.shapes[s];
    if (shape.form->happened_then) continue;
    for (const int target : along_targets(shape, out.bench))
      functions.push_back(table_of(model, effect,
                                   target < 0 ? along(model, shape.coordinate, shape.channel)
                                              : along(model, "along_mm", place_of, target),
                                   places_of_function));
  }
  const bool mixed =
      std::ranges::any_of(out.mechanisms, [](const Found& f) { return f.mechanism->id == wide_beam; });
  if (!out.several_places && !reduced.bench.knows(wide_beam))
    describe_edges(reduced, means, mixed, out.bench);
  describe_strays(reduced, out.bench);
  if (reduced.has_intensity && !out.bench.knows(law_of_intensity) && !described_intensity(out.bench))
    describe_echoes(reduced, out.bench);
  std::erase_if(functions, [](const EmpiricalFunction& f) { return f.at.empty(); });
  return functions;
}

}  // namespace fit::explain
