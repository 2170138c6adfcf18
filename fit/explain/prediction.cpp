// SPDX-License-Identifier: MIT
#include "fit/explain/prediction.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <stdexcept>

#include "fit/explain/model/term.hpp"
#include "fit/explain/runs.hpp"
#include "fit/explain/stated_noise.hpp"
#include "fit/explain/together.hpp"
#include "fit/linear_table.hpp"

namespace fit::explain {
namespace {

constexpr int places_of_table = 60;
constexpr double widest_gap = 0.1;  // of the span: nothing is known in between

/// What tables do to the mean of a cell, mm. They were found together, and may make up for each other: they
/// act where all of them were seen.
double empirical_mm(const std::vector<EmpiricalCorrection>& list, const Reduced& reduced, const Cell& cell) {
  double sum = 0;
  for (const EmpiricalCorrection& c : list) {
    const bool along_it = !c.target.empty();
    if (along_it && c.target != reduced.bench.target_at(cell.at.target).name) continue;
    const double v = along_it ? cell.at.along_mm : model::coordinate_of(c.coordinate, cell.at);
    const std::optional<double> value = std::isfinite(v) ? c.value_at(v) : std::nullopt;
    if (!value) return 0;
    sum += *value * lever_of(c.channel, cell.sight);
  }
  return sum;
}

void add_empirical_mm(const std::vector<EmpiricalCorrection>& list, Reduced& reduced) {
  for (Cell& cell : reduced.cells) cell.nominal_mm += empirical_mm(list, reduced, cell);
}

/// Variance of one sample of that cell, mm^2.
double sample_variance(const std::vector<Suspect>& noise, double constant_mm, const Cell& cell) {
  double sum = constant_mm * constant_mm;
  for (const Suspect& suspect : noise) {
    const Effect effect = suspect.mechanism->act(cell.at, suspect.mechanism->values(suspect.parameters));
    const double more =
        effect.variance_mm2 + std::pow(cell.sight.beam_lever(), 2) *
                                  (effect.scan_angle_variance_rad2 + effect.beam_angle_variance_rad2);
    if (std::isfinite(more)) sum += more;  // else the recording does not say what it depends on
    if (effect.output_step_mm > 1) sum += effect.output_step_mm * effect.output_step_mm / 12;
  }
  return sum;
}

/// Constant noise (mm) beside `noise` that makes the samples most likely: where the mean of
/// (d^2 - v) / v^2 is zero. What the means are off by counts as noise.
double best_constant(const Reduced& reduced, const std::vector<Suspect>& noise) {
  struct Part {
    double n, square, other;
  };
  std::vector<Part> parts;
  double all = 0, samples = 0;
  for (const Cell& cell : reduced.cells) {
    if (!cell.smooth || cell.n < 1) continue;
    const double off = cell.mean_mm - cell.nominal_mm;
    const double square = cell.variance_mm2 * (cell.n - 1) / cell.n + off * off;
    parts.push_back({static_cast<double>(cell.n), square, sample_variance(noise, 0, cell)});
    all += cell.n * square;
    samples += cell.n;
  }
  if (samples < 1) {
    const double stated_mm = stated_noise(reduced.bench).value;
    return stated_mm > 0 ? stated_mm : unstated_noise_mm;
  }
  const auto slope = [&](double constant2) {
    double sum = 0;
    for (const Part& p : parts) {
      const double v = p.other + constant2;
      sum += p.n * (p.square - v) / (v * v);
    }
    return sum;
  };
  constexpr double least2 = rounding_mm2;
  double low = least2, high = std::max(2 * least2, 4 * all / samples);
  if (slope(low) <= 0) return std::sqrt(low);
  for (int pass = 0; pass < 60; ++pass) {
    const double middle = std::sqrt(low * high);
    (slope(middle) > 0 ? low : high) = middle;
  }
  return std::sqrt(low);
}

/// Predicts all cells with given mechanisms and places mount and targets so that they fit best.
void place_and_predict(Reduced& reduced, const Predictor& what, bool found) {
  Hypothesis h(reduced.bench);
  std::vector<Active> at_work = all_at_work(reduced.bench, h);
  if (found)
    for (const auto& [term, target] : what.terms) {
      Active active = term.active();
      if (!target.empty()) {
        const Target* same = reduced.bench.target(target);
        if (!same) continue;
        active.target = static_cast<int>(same - reduced.bench.targets.data());
      }
      at_work.push_back(active);
    }
  const auto at_present = [&] {
    predict(reduced, h.nuisance, at_work, false);
    if (found) add_empirical_mm(what.empirical, reduced);
  };
  for (int pass = 0; pass < 4; ++pass) {
    at_present();
    for (Cell& cell : reduced.cells)
      cell.pooled_mm2 = found ? sample_variance(what.noise, what.constant_after_mm, cell)
                              : std::pow(what.constant_before_mm, 2);
    MeanModel model(reduced, {});
    const Columns places = nuisance_columns(model, h.nuisance);
    model.set_base(places.columns, places.prior);
    h.nuisance.set(h.nuisance.as_vector() + model.posterior_mean());
  }
  at_present();
}

/// Sums over samples and, of `means`, over cells.
struct Score {
  double squares = 0, means = 0, log_likelihood = 0, within = 0;

  /// Of a cell's samples, each of that variance; returns their log-likelihood.
  double add(const Reduced& reduced, const Cell& cell, double variance) {
    double of_cell = 0;
    for (std::size_t k = 0; k < static_cast<std::size_t>(cell.n); ++k) {
      const double d = static_cast<double>(reduced.kept[cell.first_kept + k]) - cell.nominal_mm;
      squares += d * d;
      of_cell += -0.5 * (d * d / variance + std::log(2 * pi * variance));
      within += std::erf(std::abs(d) / std::sqrt(2 * variance)) < 0.95;
    }
    means += std::pow(cell.mean_mm - cell.nominal_mm, 2);
    log_likelihood += of_cell;
    return of_cell;
  }
  [[nodiscard]] PredictedFigures of(double samples, double cells) const {
    return {std::sqrt(squares / samples), std::sqrt(means / cells), log_likelihood / samples,
            within / samples};
  }
};

/// An unnamed function as it came out, along that target if it is one's.
EmpiricalCorrection tabulated(const Shape& shape, const MeanModel& model, int target) {
  EmpiricalCorrection table;
  table.coordinate = shape.coordinate;
  table.channel = shape.channel;
  if (target >= 0) table.target = model.bench().target_at(target).name;
  std::vector<WeighedValue> list;
  const Eigen::VectorXd effect_mm = effect_of(model, shape);
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const double v = coordinate_at(model, shape.coordinate, i, target),
                 lever = lever_of(shape.channel, model.cell(i).sight);
    if (std::isfinite(v) && std::abs(lever) > 1e-3) list.push_back({v, effect_mm[i] / lever, lever * lever});
  }
  if (list.empty()) return table;
  const auto [first, last] = std::ranges::minmax(list, {}, &WeighedValue::at);
  const std::size_t each = list.size() / places_of_table;
  RunMeans means = means_over_runs(std::move(list), each);
  table.at = std::move(means.at);
  table.value = std::move(means.value);
  if (table.at.size() > 1) {  // the outermost runs hold to the ends of what was recorded
    table.at.front() = first.at;
    table.at.back() = last.at;
  }
  return table;
}

}  // namespace

std::optional<double> EmpiricalCorrection::value_at(double v) const {
  if (at.empty() || v < at.front() || v > at.back()) return {};
  const auto next = std::ranges::upper_bound(at, v);
  if (next == at.end()) return value.back();
  const auto i = static_cast<std::size_t>(next - at.begin());
  if (at[i] - at[i - 1] > widest_gap * (at.back() - at.front())) return {};
  return linear_in(at, value, v);
}

Predictor predictor_of(Reduced& reduced, const MeanResult& means, const SpreadResult& spread) {
  Predictor p;
  for (const Term& term : means.best.terms)
    p.terms.push_back({term, term.target < 0 ? std::string() : reduced.bench.target_at(term.target).name});
  for (const Suspect& suspect : spread.accepted)
    if (!is_constant_noise(*suspect.mechanism)) p.noise.push_back(suspect);
  for (const Suspect& suspect : spread.undecided)
    if (!is_constant_noise(*suspect.mechanism)) p.noise.push_back(suspect);
  Hypothesis nothing(reduced.bench), found = means.best;
  nothing.nuisance = means.best.nuisance;
  fit_nuisances(reduced, means.noise, 2, nothing);
  p.constant_before_mm = best_constant(reduced, {});
  if (!means.shapes_carry_over) {
    found.shapes.clear();
    fit_nuisances(reduced, means.noise, 2, found);
  } else {
    predict_at(reduced, found);
  }
  const MeanModel model(reduced, means.noise);
  for (const Shape& shape : found.shapes)
    for (const int target : along_targets(shape, model.bench()))
      if (EmpiricalCorrection table = tabulated(shape, model, target); !table.at.empty())
        p.empirical.push_back(std::move(table));
  add_empirical_mm(p.empirical, reduced);
  p.constant_after_mm = best_constant(reduced, p.noise);
  predict_at(reduced, means.best);
  return p;
}

Prediction predict_recording(const Predictor& predictor, const Recording& recording) {
  const Together alone({&recording});
  Reduced before = reduce(*alone.recordings().front(), {}, alone.standing(0), true);
  if (before.cells.empty())
    throw std::invalid_argument(
        "no beam of the recording to be predicted meets a target of its bench. Check the targets' places");
  Reduced after = before;
  place_and_predict(before, predictor, false);
  place_and_predict(after, predictor, true);
  Prediction out;
  Score first, last;
  double gains = 0, gains2 = 0;
  for (std::size_t i = 0; i < before.cells.size(); ++i) {
    const Cell &a = before.cells[i], &b = after.cells[i];
    if (!a.smooth || !b.smooth || a.n < 1) continue;
    const double v_before = predictor.constant_before_mm * predictor.constant_before_mm;
    const double v_after = sample_variance(predictor.noise, predictor.constant_after_mm, b);
    const double gain = last.add(after, b, v_after) - first.add(before, a, v_before);
    gains += gain;
    gains2 += gain * gain;
    out.samples += a.n;
    ++out.cells;
    out.shown.push_back({b.at.incidence_rad * deg_per_rad, b.at.range_mm, b.beam_rad * deg_per_rad,
                         a.mean_mm - a.nominal_mm, std::sqrt(a.variance_mm2), b.mean_mm - b.nominal_mm,
                         std::sqrt(v_before), std::sqrt(v_after)});
  }
  if (out.samples == 0)
    throw std::invalid_argument(
        "every beam of the recording to be predicted is near an edge, or grazing. Describe wider targets");
  const auto n = static_cast<double>(out.samples), cells = static_cast<double>(out.cells);
  out.before = first.of(n, cells);
  out.after = last.of(n, cells);
  out.gain = gains;
  out.u_gain = std::sqrt(std::max(0.0, gains2 - gains * gains / cells));
  return out;
}

}  // namespace fit::explain
