// SPDX-License-Identifier: MIT
#include "fit/explain/prediction.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <numeric>
#include <span>
#include <stdexcept>
#include <utility>

#include "fit/bench/empirical.hpp"
#include "fit/explain/model/gaussian.hpp"
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

/// Of the cells that can be predicted, by capture. `u2_mm2`: variance of where each of them is predicted.
std::map<int, Parts> parts_of(const Reduced& reduced, const std::vector<Active>& known,
                              const std::vector<double>& u2_mm2 = {}) {
  std::map<int, Parts> of_capture;
  for (std::size_t i = 0; i < reduced.cells.size(); ++i) {
    const Cell& cell = reduced.cells[i];
    if (!cell.usable || cell.n < 1) continue;
    const double off = cell.off_mm();
    of_capture[reduced.group_of(cell).capture].push_back(
        {static_cast<double>(cell.n), cell.variance_mm2 * (cell.n - 1) / cell.n + off * off,
         variance_of_sample(known, cell) + (u2_mm2.empty() ? 0 : u2_mm2[i])});
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
  const std::map<int, Parts> of_capture = parts_of(reduced, known_effects(reduced.bench));
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

/// A recording under one description. What is drawn anew for it (mount, targets, the captures' constant
/// noise) and what the description leaves open (values of mechanisms within their uncertainties, how they
/// deviate from their formulas) is integrated over, by Laplace's method.
class PredictiveDistribution {
 public:
  PredictiveDistribution(Reduced recording, const std::vector<KnownMechanism>& found,
                         const std::vector<EmpiricalFunction>& functions, const ConstantNoise& constant)
      : reduced_(std::move(recording)), constant_(constant), there_(reduced_.bench) {
    for (const KnownMechanism& one : found)
      if (!states(reduced_.bench, one)) add_known(reduced_.bench, one);
    known_ = known_effects(reduced_.bench);
    at_work_ = known_terms(reduced_.bench);
    at_work_.push_back(as_one(functions, reduced_.bench));
    for (int pass = 0; pass < 4; ++pass) {
      predict(reduced_, there_, at_work_, false);
      pool(constant.mm * constant.mm);
      MeanModel model(reduced_, {});
      const Columns places = nuisance_columns(model, there_);
      model.set_base(places.columns, places.prior);
      there_.set(there_.as_vector() + model.posterior_mean());
    }
    predict(reduced_, there_, at_work_, false);
    reassign(reduced_, there_, at_work_, 0);
  }

  [[nodiscard]] bool is_predicted(std::size_t cell) const {
    return reduced_.cells[cell].usable && reduced_.cells[cell].n > 0;
  }
  void leave_out(std::size_t cell) { reduced_.cells[cell].usable = false; }

  /// All that follows is asked for once no more cells are left out.
  void integrate() {
    const auto by_cell = [&](const MeanModel& model, const Eigen::VectorXd& of_rows) {
      std::vector<double> list(reduced_.cells.size(), 0.0);
      for (Eigen::Index i = 0; i < model.rows(); ++i)
        list[static_cast<std::size_t>(&model.cell(i) - reduced_.cells.data())] = of_rows[i];
      return list;
    };
    pool(constant_.mm * constant_.mm);
    MeanModel stated(reduced_, {});
    Columns all = nuisance_columns(stated, there_);
    const Eigen::MatrixXd open = uncertainty_columns(stated, known_terms(reduced_.bench)).columns;
    stated.set_base(all.columns, all.prior);
    // What one standard uncertainty of each value and deviation makes of the means beside the places.
    Eigen::VectorXd u2 = Eigen::VectorXd::Zero(stated.rows());
    for (Eigen::Index k = 0; k < open.cols(); ++k) u2 += stated.remainder(open.col(k)).cwiseAbs2();
    u2_mm2_ = by_cell(stated, u2);
    log_occam_ = 0;
    for (const auto& [capture, parts] : parts_of(reduced_, known_, u2_mm2_)) {
      of_capture_[capture] = OfCapture(constant_, parts);
      log_occam_ += of_capture_[capture].log_occam;
    }
    for (Cell& cell : reduced_.cells)
      if (cell.usable) cell.pooled_mm2 = variance_mm2(cell);
    all.append(open, Prior::around_zero(open.cols()));
    MeanModel fitted(reduced_, {});
    fitted.set_base(all.columns, all.prior);
    log_occam_ += fitted.log_occam();
    const std::vector<double> shift_mm = by_cell(fitted, all.columns * fitted.posterior_mean());
    density_.assign(reduced_.cells.size(), 0.0);
    for (std::size_t i = 0; i < reduced_.cells.size(); ++i)
      if (is_predicted(i)) density_[i] = log_density(reduced_.cells[i], shift_mm[i]);
  }
  /// Of the recording as a whole.
  [[nodiscard]] double log_likelihood() const {
    return std::accumulate(density_.begin(), density_.end(), 0.0) - log_occam_;
  }
  /// Of a cell's samples, where all fits best.
  [[nodiscard]] double log_density(std::size_t cell) const { return density_[cell]; }
  [[nodiscard]] double mean_mm(std::size_t cell) const { return reduced_.cells[cell].nominal_mm; }
  /// Of one sample about that mean: its noise, and what the description leaves open.
  [[nodiscard]] double variance_mm2(std::size_t cell) const {
    return variance_mm2(reduced_.cells[cell]) + u2_mm2_[cell];
  }
  [[nodiscard]] const Reduced& recording() const { return reduced_; }

 private:
  void pool(double constant_mm2) {
    for (Cell& cell : reduced_.cells) cell.pooled_mm2 = constant_mm2 + variance_of_sample(known_, cell);
  }
  [[nodiscard]] double variance_mm2(const Cell& cell) const {
    return of_capture_.at(reduced_.group_of(cell).capture).variance_mm2 + variance_of_sample(known_, cell);
  }
  [[nodiscard]] double log_density(const Cell& cell, double shift_mm) const {
    const double variance = variance_mm2(cell), mean = cell.nominal_mm + shift_mm;
    double sum = 0;
    for (std::size_t k = 0; k < static_cast<std::size_t>(cell.n); ++k) {
      const double d = static_cast<double>(reduced_.kept[cell.first_kept + k]) - mean;
      sum -= 0.5 * (d * d / variance + std::log(2 * pi * variance));
    }
    return sum;
  }

  Reduced reduced_;
  ConstantNoise constant_;
  Nuisance there_;
  std::vector<Active> known_, at_work_;
  std::map<int, OfCapture> of_capture_;
  std::vector<double> u2_mm2_, density_;
  double log_occam_ = 0;
};

/// Descriptions of which one is true, as probable as stated: of a cell their mean, and the variance of one
/// sample, with what they differ by.
struct Mixture {
  double mean_mm = 0, variance_mm2 = 0;

  Mixture(std::span<const PredictiveDistribution> each, std::span<const double> probabilities,
          std::size_t cell) {
    for (std::size_t k = 0; k < each.size(); ++k) mean_mm += probabilities[k] * each[k].mean_mm(cell);
    for (std::size_t k = 0; k < each.size(); ++k)
      variance_mm2 +=
          probabilities[k] * (each[k].variance_mm2(cell) + std::pow(each[k].mean_mm(cell) - mean_mm, 2));
  }
};

/// Sums over samples and, of `means`, over cells.
struct Score {
  double squares = 0, means = 0, within = 0;

  void add(const Reduced& reduced, const Cell& cell, const Mixture& predicted) {
    for (std::size_t k = 0; k < static_cast<std::size_t>(cell.n); ++k) {
      const double d = static_cast<double>(reduced.kept[cell.first_kept + k]) - predicted.mean_mm;
      squares += d * d;
      within += std::erf(std::abs(d) / std::sqrt(2 * predicted.variance_mm2)) < 0.95;
    }
    means += std::pow(cell.mean_mm - predicted.mean_mm, 2);
  }
  [[nodiscard]] PredictedFigures of(double samples, double cells, double log_likelihood) const {
    return {std::sqrt(squares / samples), std::sqrt(means / cells), log_likelihood / samples,
            within / samples};
  }
};

}  // namespace

Predictor predictor_of(Reduced& reduced, const MeanResult& means,
                       const std::vector<Alternative>& alternatives,
                       const std::vector<EmpiricalFunction>& functions) {
  constexpr int passes = 2;
  const auto name_of = [&](int target) {
    return target < 0 ? std::string() : reduced.bench.target_at(target).name;
  };
  Predictor p;
  p.functions = functions;
  Hypothesis nothing(reduced.bench);
  nothing.nuisance = means.best.nuisance;
  fit_nuisances(reduced, means.noise, passes, nothing);
  p.constant_before = constant_noise_of(reduced);
  const Bench stated = reduced.bench;
  for (const Alternative& alternative : alternatives) {
    Predictor::Description description{alternative.probability, {}, {}};
    for (const Suspect& suspect : alternative.mechanisms) {
      if (is_constant_noise(*suspect.mechanism)) continue;
      const KnownMechanism known = as_known(*suspect.mechanism, suspect.parameters, name_of(suspect.target));
      add_known(reduced.bench, known);
      if (!suspect.mechanism->happened_once(suspect.mechanism->values(suspect.parameters)))
        description.mechanisms.push_back(known);
    }
    Hypothesis found(reduced.bench);
    found.nuisance = means.best.nuisance;
    if (functions.empty()) {
      fit_nuisances(reduced, means.noise, passes, found);
    } else {
      std::vector<Active> at_work = known_terms(reduced.bench);
      at_work.push_back(as_one(functions, reduced.bench));
      predict(reduced, found.nuisance, at_work, false);
    }
    description.constant = constant_noise_of(reduced);
    p.descriptions.push_back(std::move(description));
    reduced.bench = stated;
  }
  return p;
}

Prediction predict_recording(const Predictor& predictor, const Recording& recording) {
  Reading reading({&recording}, {}, true);
  const Reduced reduced = reading.take_reduced();
  PredictiveDistribution before(reduced, {}, {}, predictor.constant_before);
  std::vector<PredictiveDistribution> after;
  std::vector<double> probabilities;
  for (const Predictor::Description& one : predictor.descriptions) {
    after.emplace_back(reduced, one.mechanisms, predictor.functions, one.constant);
    probabilities.push_back(one.probability);
  }
  Prediction out;
  out.notes = reading.notes();
  for (std::size_t i = 0; i < reduced.cells.size(); ++i) {
    if (before.is_predicted(i) &&
        std::ranges::all_of(after, [&](const PredictiveDistribution& one) { return one.is_predicted(i); })) {
      ++out.cells;
      out.samples += reduced.cells[i].n;
      continue;
    }
    before.leave_out(i);
    for (PredictiveDistribution& one : after) one.leave_out(i);
  }
  if (out.samples == 0)
    throw std::invalid_argument(
        "every beam of the recording to be predicted is near an edge, or grazing. Describe wider targets");
  before.integrate();
  std::vector<double> joint;
  for (std::size_t k = 0; k < after.size(); ++k) {
    after[k].integrate();
    joint.push_back(std::log(probabilities[k]) + after[k].log_likelihood());
  }
  const double log_after = inference::log_sum(joint);
  const auto best = after.begin() + (std::ranges::max_element(joint) - joint.begin());
  constexpr std::array certain{1.0};
  Score first, last;
  double gains = 0, gains2 = 0;
  for (std::size_t i = 0; i < reduced.cells.size(); ++i) {
    if (!before.is_predicted(i)) continue;
    const Cell &a = before.recording().cells[i], &b = best->recording().cells[i];
    const Mixture without({&before, 1}, certain, i), with(after, probabilities, i);
    first.add(reduced, a, without);
    last.add(reduced, b, with);
    const double gain = best->log_density(i) - before.log_density(i);
    gains += gain;
    gains2 += gain * gain;
    out.shown.push_back({b.at.incidence_rad * deg_per_rad, b.at.range_mm, b.beam_rad * deg_per_rad,
                         a.mean_mm - without.mean_mm, std::sqrt(a.variance_mm2), b.mean_mm - with.mean_mm,
                         std::sqrt(without.variance_mm2), std::sqrt(with.variance_mm2)});
  }
  const auto n = static_cast<double>(out.samples), cells = static_cast<double>(out.cells);
  out.before = first.of(n, cells, before.log_likelihood());
  out.after = last.of(n, cells, log_after);
  out.gain = log_after - before.log_likelihood();
  out.u_gain = std::sqrt(std::max(0.0, gains2 - gains * gains / cells));
  return out;
}

}  // namespace fit::explain
