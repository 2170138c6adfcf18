// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/named.hpp"

#include <nlopt.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "fit/explain/odds.hpp"

namespace fit::explain::intensity {
namespace {

using Role = Parameter::Role;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using odds::price_of_mechanism;

Suspicion without_values(const Mechanism& m, int target) {
  Suspicion s;
  s.mechanism = &m;
  s.target = target;
  s.values.assign(m.parameters.size(), 0);
  return s;
}

/// Every combination of a mechanism's shape parameters to start from; its size, the first one, is open.
std::vector<Suspicion> starts_of(const Mechanism& m, int target) {
  std::vector<Suspicion> grid{without_values(m, target)};
  for (std::size_t k = 1; k < m.parameters.size(); ++k) {
    const Parameter& p = m.parameters[k];
    std::vector<Suspicion> more;
    const int starts = p.logarithmic ? std::max(4, p.starts) : 2 * p.starts;
    for (const Suspicion& s : grid)
      for (int i = 0; i < starts; ++i) {
        const double f = static_cast<double>(i) / (starts - 1);
        more.push_back(s);
        more.back().values[k] =
            p.logarithmic ? p.lower * std::pow(p.upper / p.lower, f) : p.lower + f * (p.upper - p.lower);
      }
    grid = std::move(more);
  }
  return grid;
}

/// Solves for the size at the shape as it is; `rest` is the model's residual in standard uncertainties.
void solve_size(const Readings& readings, const Model& model, const VectorXd& rest, Suspicion& s) {
  const Mechanism& m = *s.mechanism;
  s.gain = -1e300;
  double size = 0.05 * m.parameters[0].typical;
  for (int pass = 0; pass < 2; ++pass) {  // sizes are not quite linear in the logarithm
    s.values[0] = size;
    const VectorXd effect = effect_of(readings, s) / size;
    if (effect.cwiseAbs().maxCoeff() < 1e-9) return;
    const VectorXd left = model.left_of(effect);
    const double square = left.dot(left);
    if (square < 1e-9) return;
    const double wanted = left.dot(rest) / square;
    s.gain = wanted * m.parameters[0].sign < 0 ? -1e300 : 0.5 * wanted * wanted * square;
    if (s.gain < 0) return;
    const bool brightens = effect.sum() > 0;
    size = brightens ? std::clamp(std::expm1(std::min(4.0, wanted)), 1e-4, 50.0)
                     : std::clamp(1 - std::exp(-wanted), 1e-4, 0.95);
    s.values[0] = size;
  }
}

/// A mechanism's values as the optimiser has them, one a searched parameter: start, bounds, first step.
struct SearchBox {
  std::vector<double> start, low, high, step;
};

SearchBox box_of(const Suspicion& s, const std::vector<Searched>& list) {
  SearchBox box;
  for (const auto& [k, sigma] : list) {
    const Parameter& p = s.mechanism->parameters[k];
    const bool logarithm = by_logarithm(p), size = p.role == Role::size;
    box.low.push_back(size ? (p.sign > 0 ? 0 : -0.95) : logarithm ? std::log(p.lower) : p.lower);
    box.high.push_back(size ? std::min(p.largest, 60 * p.typical) : logarithm ? std::log(p.upper) : p.upper);
    const double value = logarithm ? std::log(s.values[k]) : s.values[k];
    box.start.push_back(std::clamp(value, box.low.back(), box.high.back()));
    box.step.push_back(size        ? std::max(0.01, 0.3 * std::abs(s.values[k]))
                       : logarithm ? 0.3
                                   : 0.3 * s.values.back());  // of a place: by the width, which comes last
    if (!(std::abs(box.step.back()) > 1e-6)) box.step.back() = 0.1 * sigma;
  }
  return box;
}

/// A size of that many usual ones, believed at a price.
struct OutOfTheUsual {
  double scale = 1;  ///< Factor on the prior's standard deviation.
  double price = 0;
};
OutOfTheUsual out_of_the_usual(double ratio) {
  constexpr double least = 1e-4;
  if (ratio > 1) return {ratio, 0.5 + std::log(ratio)};
  // Sizes in the catalogue are orders of magnitude: a prior as wide as the size that was found may be
  // cheaper.
  const double own = std::max(least, ratio), usual = 0.5 * ratio * ratio,
               smaller = 0.5 + price_of_scale(own, 1);
  return smaller < usual - std::log(own) ? OutOfTheUsual{own, smaller} : OutOfTheUsual{1, usual};
}

/// Evidence of an effect around its best values (Laplace), over what the base explains.
void weigh_up(const Readings& readings, const Model& model, Suspicion& s) {
  const std::vector<Searched> list = searched(*s.mechanism);
  MatrixXd slopes(readings.count(), static_cast<Index>(list.size()));
  VectorXd prior(static_cast<Index>(list.size()));
  double far = 0;
  for (std::size_t j = 0; j < list.size(); ++j) {
    const auto [k, sigma] = list[j];
    slopes.col(static_cast<Index>(j)) = slope_of(readings, s, list[j]);
    prior[static_cast<Index>(j)] = sigma;
    if (s.mechanism->parameters[k].role != Role::size) continue;
    const auto [scale, price] = out_of_the_usual(std::abs(s.values[k]) / sigma);
    prior[static_cast<Index>(j)] *= scale;
    far += price;
  }
  MatrixXd normal = prior.asDiagonal() * model.products(slopes).square * prior.asDiagonal();
  normal.diagonal().array() += 1;
  const Eigen::LLT<MatrixXd> factor(normal);
  double log_det = 0;
  for (Index i = 0; i < normal.rows(); ++i) log_det += std::log(factor.matrixL()(i, i));
  s.gain = model.gain(effect_of(readings, s));
  s.evidence = s.gain - log_det - far - price_of_mechanism;
  if (s.target >= 0) s.evidence -= std::log(static_cast<double>(readings.reduced.bench.targets.size()));
}

/// Which coefficients may be wrong together.
std::vector<std::vector<int>> choices_of(const std::vector<int>& stated) {
  std::vector<std::vector<int>> choices;
  for (const int k : stated) choices.push_back({k});
  for (std::size_t i = 0; i < stated.size(); ++i)
    for (std::size_t j = i + 1; j < stated.size(); ++j) choices.push_back({stated[i], stated[j]});
  if (stated.size() > 2) choices.push_back(stated);
  return choices;
}

}  // namespace

void refine(const Readings& readings, const Model& model, Suspicion& s, int evaluations) {
  struct Context {
    const Readings& readings;
    const Model& model;
    Suspicion start;
    std::vector<Searched> list;
    [[nodiscard]] Suspicion at(const double* x) const {
      Suspicion there = start;
      for (std::size_t j = 0; j < list.size(); ++j) {
        const std::size_t k = list[j].parameter;
        there.values[k] = by_logarithm(there.mechanism->parameters[k]) ? std::exp(x[j]) : x[j];
      }
      return there;
    }
    static double gain(unsigned, const double* x, double*, void* data) {
      const auto& c = *static_cast<Context*>(data);
      return c.model.gain(effect_of(c.readings, c.at(x)));
    }
  } context{readings, model, s, searched(*s.mechanism)};
  SearchBox box = box_of(s, context.list);
  nlopt_opt optimiser = nlopt_create(NLOPT_LN_NELDERMEAD, static_cast<unsigned>(box.start.size()));
  nlopt_set_lower_bounds(optimiser, box.low.data());
  nlopt_set_upper_bounds(optimiser, box.high.data());
  nlopt_set_initial_step(optimiser, box.step.data());
  nlopt_set_maxeval(optimiser, evaluations);
  nlopt_set_ftol_abs(optimiser, 0.01);
  nlopt_set_max_objective(optimiser, &Context::gain, &context);
  double best = 0;
  nlopt_optimize(optimiser, box.start.data(), &best);
  nlopt_destroy(optimiser);
  s = context.at(box.start.data());
}

Suspicion look(const Readings& readings, const Model& model, const Mechanism& m, int target) {
  const VectorXd rest = model.residual().cwiseProduct(model.weight());
  std::vector<Suspicion> grid = starts_of(m, target);
  for (Suspicion& s : grid) solve_size(readings, model, rest, s);
  std::ranges::sort(grid, [](const Suspicion& a, const Suspicion& b) { return a.gain > b.gain; });
  Suspicion best = without_values(m, target);
  for (std::size_t i = 0; i < std::min<std::size_t>(2, grid.size()); ++i) {
    if (grid[i].gain < 3 || grid[i].gain < grid[0].gain - 10) break;
    refine(readings, model, grid[i], 120);
    weigh_up(readings, model, grid[i]);
    if (grid[i].evidence > best.evidence) best = grid[i];
  }
  return best;
}

Suspicion look_at_law(const Readings& readings, const Model& model) {
  const std::vector<std::vector<int>> choices = choices_of(stated_coefficients(readings.claim));
  const MatrixXd columns = law_columns(readings, readings.claim.law);
  Suspicion best;
  best.mechanism = find_mechanism(law_of_intensity);
  for (const std::vector<int>& choice : choices) {
    Block block;
    for (const int k : choice) block.add(columns.col(k), released[static_cast<std::size_t>(k)]);
    const MeanModel::Fit fit = MeanModel::solve(model.products(block.columns),
                                                {VectorXd::Zero(block.sigma.size()), block.sigma}, true);
    const double evidence = fit.evidence - price_of_mechanism - std::log(static_cast<double>(choices.size()));
    if (evidence <= best.evidence) continue;
    best.evidence = evidence;
    best.gain = fit.gain;
    best.coefficients = choice;
    best.values.assign(fit.value.data(), fit.value.data() + fit.value.size());
    best.size = std::max(1.0, (fit.value.cwiseAbs().cwiseQuotient(block.sigma)).maxCoeff());
  }
  return best;
}

}  // namespace fit::explain::intensity
