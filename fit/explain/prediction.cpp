// SPDX-License-Identifier: MIT
#include "fit/explain/prediction.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <stdexcept>

#include "fit/explain/inference/runs.hpp"
#include "fit/explain/model/term.hpp"
#include "fit/explain/reduction/together.hpp"
#include "fit/explain/scene/stated_noise.hpp"
#include "fit/numeric/linear_table.hpp"

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
double sample_variance(const std::vector<Suspect>& noise, double constant_mm2, const Cell& cell) {
  double sum = constant_mm2;
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

/// Squares of a cell's samples about what was predicted, and the variance that is known of each.
struct Part {
  double n, square, other;
};
using Parts = std::vector<Part>;

/// Of the cells that can be predicted, by capture.
std::map<int, Parts> parts_of(const Reduced& reduced, const std::vector<Suspect>& noise) {
  std::map<int, Parts> of_capture;
  for (const Cell& cell : reduced.cells) {
    if (!cell.smooth || cell.n < 1) continue;
    const double off = cell.mean_mm - cell.nominal_mm;
    of_capture[reduced.group_of(cell).capture].push_back(
        {static_cast<double>(cell.n), cell.variance_mm2 * (cell.n - 1) / cell.n + off * off,
         sample_variance(noise, 0, cell)});
  }
  return of_capture;
}

/// Logarithm of the constant variance beside the known ones, mm^2, that is the most probable of these
/// samples, normal before with that mean and `precision` (0: anything). What the means are off by counts as
/// noise.
double best_log_constant(const Parts& parts, double mean = 0, double precision = 0) {
  double all = 0, samples = 0;
  for (const Part& part : parts) all += part.n * part.square, samples += part.n;
  const auto slope = [&](double log_constant) {
    double sum = 0;
    for (const Part& part : parts) {
      const double v = part.other + std::exp(log_constant);
      sum += part.n * (part.square - v) / (v * v);
    }
    return sum * std::exp(log_constant) / 2 - precision * (log_constant - mean);
  };
  double low = std::log(rounding_mm2), high = std::log(std::max(2 * rounding_mm2, 4 * all / samples));
  if (slope(low) <= 0) return low;
  for (int pass = 0; pass < 60; ++pass) {
    const double middle = (low + high) / 2;
    (slope(middle) > 0 ? low : high) = middle;
  }
  return low;
}

/// Fisher information of the samples on that logarithm.
double information_on(const Parts& parts, double log_constant) {
  const double constant = std::exp(log_constant);
  double sum = 0;
  for (const Part& part : parts) sum += part.n / 2 * std::pow(constant / (part.other + constant), 2);
  return sum;
}

/// The captures' constant noise as a random effect. Its variance is DerSimonian and Laird's (1986): what the
/// captures' logarithms scatter by beyond their uncertainties.
ConstantNoise constant_noise_of(const Reduced& reduced, const std::vector<Suspect>& noise) {
  const std::map<int, Parts> of_capture = parts_of(reduced, noise);
  if (of_capture.empty()) {
    const double stated_mm = stated_noise(reduced.bench).value;
    return {stated_mm > 0 ? stated_mm : unstated_noise_mm};
  }
  Parts all;
  std::vector<std::pair<double, double>> known;  // logarithm, its variance
  for (const auto& [capture, parts] : of_capture) {
    all.insert(all.end(), parts.begin(), parts.end());
    const double log_constant = best_log_constant(parts);
    known.emplace_back(log_constant, 1 / information_on(parts, log_constant));
  }
  struct Mean {
    double value = 0, weights = 0, squares = 0;
  };
  const auto mean_with = [&](double tau2) {
    Mean mean;
    for (const auto& [log_constant, variance] : known) {
      const double w = 1 / (variance + tau2);
      mean.value += w * log_constant, mean.weights += w, mean.squares += w * w;
    }
    mean.value /= mean.weights;
    return mean;
  };
  const Mean fixed = mean_with(0);
  double q = 0;
  for (const auto& [log_constant, variance] : known) q += std::pow(log_constant - fixed.value, 2) / variance;
  const double freedom = static_cast<double>(known.size()) - 1,
               tau2 = freedom < 1 ? 0 : (q - freedom) / (fixed.weights - fixed.squares / fixed.weights);
  if (!(tau2 > 0)) return {std::exp(best_log_constant(all) / 2)};
  const Mean mean = mean_with(tau2);
  return {std::exp(mean.value / 2), std::sqrt(tau2 + 1 / mean.weights)};
}

/// Constant variance of a capture as its own samples and all others have it, mm^2; and what the
/// log-likelihood at that value is more than the integral over all values (Laplace).
struct OfCapture {
  double variance_mm2 = 0, log_occam = 0;

  OfCapture() = default;
  OfCapture(const ConstantNoise& constant, const Parts& parts) : variance_mm2(constant.mm * constant.mm) {
    if (constant.log_spread == 0) return;
    const double mean = 2 * std::log(constant.mm), precision = 1 / std::pow(constant.log_spread, 2);
    const double best = best_log_constant(parts, mean, precision);
    variance_mm2 = std::exp(best);
    log_occam = precision * std::pow(best - mean, 2) / 2 +
                std::log((information_on(parts, best) + precision) / precision) / 2;
  }
};

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
      cell.pooled_mm2 = found ? sample_variance(what.noise, std::pow(what.constant_after.mm, 2), cell)
                              : std::pow(what.constant_before.mm, 2);
    MeanModel model(reduced, {});
    const Columns places = nuisance_columns(model, h.nuisance);
    model.set_base(places.columns, places.prior);
    h.nuisance.set(h.nuisance.as_vector() + model.posterior_mean());
  }
  at_present();
}

std::map<int, OfCapture> noise_of_captures(const Reduced& reduced, const ConstantNoise& constant,
                                           const std::vector<Suspect>& noise) {
  std::map<int, OfCapture> list;
  for (const auto& [capture, parts] : parts_of(reduced, noise)) list[capture] = OfCapture(constant, parts);
  return list;
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

Predictor predictor_of(Reduced& reduced, const MeanResult& means, const std::vector<Suspect>& accepted,
                       const std::vector<Suspect>& undecided) {
  Predictor p;
  for (const Term& term : means.best.terms)
    p.terms.push_back({term, term.target < 0 ? std::string() : reduced.bench.target_at(term.target).name});
  for (const auto* list : {&accepted, &undecided})
    for (const Suspect& suspect : *list)
      if (!is_constant_noise(*suspect.mechanism)) p.noise.push_back(suspect);
  Hypothesis nothing(reduced.bench), found = means.best;
  nothing.nuisance = means.best.nuisance;
  fit_nuisances(reduced, means.noise, 2, nothing);
  p.constant_before = constant_noise_of(reduced, {});
  if (!means.shapes_carry_over) {
    found.shapes.clear();
    fit_nuisances(reduced, means.noise, 2, found);
  } else {
    predict_at(reduced, found);
  }
  const MeanModel model(reduced, means.noise);
  for (const Shape& shape : found.shapes) {
    if (shape.form->happened_then) continue;
    for (const int target : along_targets(shape, model.bench()))
      if (EmpiricalCorrection table = tabulated(shape, model, target); !table.at.empty())
        p.empirical.push_back(std::move(table));
  }
  add_empirical_mm(p.empirical, reduced);
  p.constant_after = constant_noise_of(reduced, p.noise);
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
  const auto noise_before = noise_of_captures(before, predictor.constant_before, {}),
             noise_after = noise_of_captures(after, predictor.constant_after, predictor.noise);
  Score first, last;
  double gains = 0, gains2 = 0;
  for (std::size_t i = 0; i < before.cells.size(); ++i) {
    const Cell &a = before.cells[i], &b = after.cells[i];
    if (!a.smooth || !b.smooth || a.n < 1) continue;
    const int capture = before.group_of(a).capture;
    const double v_before = noise_before.at(capture).variance_mm2,
                 v_after = sample_variance(predictor.noise, noise_after.at(capture).variance_mm2, b);
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
  const double u_gain2 = gains2 - gains * gains / cells;
  for (const auto& [capture, noise] : noise_before) {
    const double after_occam = noise_after.at(capture).log_occam;
    first.log_likelihood -= noise.log_occam;
    last.log_likelihood -= after_occam;
    gains += noise.log_occam - after_occam;
  }
  out.before = first.of(n, cells);
  out.after = last.of(n, cells);
  out.gain = gains;
  out.u_gain = std::sqrt(std::max(0.0, u_gain2));
  return out;
}

}  // namespace fit::explain
