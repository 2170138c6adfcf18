// SPDX-License-Identifier: MIT
#include "fit/explain/prediction.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <span>
#include <stdexcept>

#include "fit/bench/empirical.hpp"
#include "fit/explain/reading.hpp"
#include "fit/explain/scene/stated_noise.hpp"

namespace fit::explain {
namespace {

/// Functions without a name as one: they were found together and may make up for each other, and act where
/// all of them were seen.
Active as_one(const std::vector<EmpiricalFunction>& functions, const Bench& bench) {
  struct OneOfThem {
    EmpiricalFunction function;
    int target;
    Mechanism acts;
  };
  std::vector<OneOfThem> parts;
  for (const EmpiricalFunction& f : functions) {
    const Target* target = bench.target(f.target);
    if (!f.target.empty() && !target) continue;
    parts.push_back(
        {f, target ? static_cast<int>(target - bench.targets.data()) : -1, as_mechanism(f, bench)});
  }
  auto all = std::make_shared<Mechanism>();
  all->act = [parts](const Circumstances& at, std::span<const double>) {
    Effect sum;
    for (const OneOfThem& part : parts) {
      if (part.target >= 0 && part.target != at.target) continue;
      if (!part.function.covers(part.function.place_of(at))) return Effect{};
      sum += part.acts.act(at, {});
    }
    return sum;
  };
  return {all, {}};
}

/// Whether the bench says that mechanism of that target by itself.
bool states(const Bench& bench, const KnownMechanism& found) {
  return std::ranges::any_of(bench.known, [&](const KnownMechanism& known) {
    return known.mechanism == found.mechanism && known.texts == found.texts;
  });
}

/// Squares of a cell's samples about what was predicted, and the variance that is known of each.
struct Part {
  double n, square, other;
};
using Parts = std::vector<Part>;

/// Of the cells that can be predicted, by capture.
std::map<int, Parts> parts_of(const Reduced& reduced) {
  const std::vector<Active> known = known_effects(reduced.bench);
  std::map<int, Parts> of_capture;
  for (const Cell& cell : reduced.cells) {
    if (!cell.usable || cell.n < 1) continue;
    const double off = cell.mean_mm - cell.nominal_mm;
    of_capture[reduced.group_of(cell).capture].push_back(
        {static_cast<double>(cell.n), cell.variance_mm2 * (cell.n - 1) / cell.n + off * off,
         variance_of_sample(known, cell)});
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
ConstantNoise constant_noise_of(const Reduced& reduced) {
  const std::map<int, Parts> of_capture = parts_of(reduced);
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

/// Predicts all cells by what the bench knows and such functions, with mount and targets where they fit best.
void place_and_predict(Reduced& reduced, const std::vector<EmpiricalFunction>& functions,
                       const ConstantNoise& constant) {
  const std::vector<Active> known = known_effects(reduced.bench);
  std::vector<Active> at_work = known_terms(reduced.bench);
  at_work.push_back(as_one(functions, reduced.bench));
  Nuisance there(reduced.bench);
  for (int pass = 0; pass < 4; ++pass) {
    predict(reduced, there, at_work, false);
    for (Cell& cell : reduced.cells)
      cell.pooled_mm2 = constant.mm * constant.mm + variance_of_sample(known, cell);
    MeanModel model(reduced, {});
    const Columns places = nuisance_columns(model, there);
    model.set_base(places.columns, places.prior);
    there.set(there.as_vector() + model.posterior_mean());
  }
  predict(reduced, there, at_work, false);
  reassign(reduced, there, at_work, 0);
}

std::map<int, OfCapture> noise_of_captures(const Reduced& reduced, const ConstantNoise& constant) {
  std::map<int, OfCapture> list;
  for (const auto& [capture, parts] : parts_of(reduced)) list[capture] = OfCapture(constant, parts);
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

}  // namespace

Predictor predictor_of(Reduced& reduced, const MeanResult& means, const std::vector<Suspect>& accepted,
                       const std::vector<Suspect>& undecided,
                       const std::vector<EmpiricalFunction>& functions) {
  constexpr int passes = 2;
  const auto name_of = [&](int target) {
    return target < 0 ? std::string() : reduced.bench.target_at(target).name;
  };
  Predictor p;
  p.functions = functions;
  std::vector<KnownMechanism> all;  // with what happened once, in no other recording
  const auto add = [&](const Mechanism& m, std::map<std::string, Estimate> parameters, int target) {
    all.push_back(as_known(m, std::move(parameters), name_of(target)));
    if (!m.happened_once()) p.mechanisms.push_back(all.back());
  };
  for (const Active& term : means.best.terms) {
    std::map<std::string, Estimate> parameters;
    for (std::size_t k = 0; k < term.values.size(); ++k)
      parameters[term.mechanism->parameters[k].name] = {term.values[k], term.sigma[k]};
    add(*term.mechanism, std::move(parameters), term.target);
  }
  for (const auto* list : {&accepted, &undecided})
    for (const Suspect& suspect : *list)
      if (!is_constant_noise(*suspect.mechanism)) add(*suspect.mechanism, suspect.parameters, suspect.target);
  Hypothesis nothing(reduced.bench);
  nothing.nuisance = means.best.nuisance;
  fit_nuisances(reduced, means.noise, passes, nothing);
  p.constant_before = constant_noise_of(reduced);
  for (const KnownMechanism& found_one : all) add_known(reduced.bench, found_one);
  Hypothesis found(reduced.bench);
  found.nuisance = means.best.nuisance;
  if (functions.empty()) {
    fit_nuisances(reduced, means.noise, passes, found);
  } else {
    std::vector<Active> at_work = known_terms(reduced.bench);
    at_work.push_back(as_one(functions, reduced.bench));
    predict(reduced, found.nuisance, at_work, false);
  }
  p.constant_after = constant_noise_of(reduced);
  return p;
}

Prediction predict_recording(const Predictor& predictor, const Recording& recording) {
  Reading reading({&recording}, {}, true);
  Reduced before = reading.take_reduced();
  Reduced after = before;
  for (const KnownMechanism& found : predictor.mechanisms)
    if (!states(before.bench, found)) add_known(after.bench, found);
  place_and_predict(before, {}, predictor.constant_before);
  place_and_predict(after, predictor.functions, predictor.constant_after);
  const std::vector<Active> known_before = known_effects(before.bench),
                            known_after = known_effects(after.bench);
  Prediction out;
  out.notes = reading.notes();
  const auto noise_before = noise_of_captures(before, predictor.constant_before),
             noise_after = noise_of_captures(after, predictor.constant_after);
  Score first, last;
  double gains = 0, gains2 = 0;
  for (std::size_t i = 0; i < before.cells.size(); ++i) {
    const Cell &a = before.cells[i], &b = after.cells[i];
    if (!a.usable || !b.usable || a.n < 1) continue;
    const int capture = before.group_of(a).capture;
    const double v_before = noise_before.at(capture).variance_mm2 + variance_of_sample(known_before, a),
                 v_after = noise_after.at(capture).variance_mm2 + variance_of_sample(known_after, b);
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
