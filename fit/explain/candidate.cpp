// SPDX-License-Identifier: MIT
#include "fit/explain/candidate.hpp"

#include <nlopt.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <unsupported/Eigen/FFT>
#include <utility>

#include "fit/explain/odds.hpp"
#include "fit/explain/sampling.hpp"

namespace fit::explain {
namespace {

using Role = Parameter::Role;

/// Independent places that the search over a shape parameter looks at.
double places_of(const Parameter& p) { return std::max(1.5, p.starts / 3.0); }

/// Periods of gears are whole fractions of a turn.
bool possible(const Mechanism& m, const std::vector<double>& values, std::optional<double> spacing_deg) {
  const auto gear = m.parameter_of(Parameter::Scale::gear);
  if (!gear) return true;
  const double period = values[*gear];
  if (spacing_deg && looks_slow(period, *spacing_deg)) return false;
  if (period < 24) return true;
  return std::abs(360 / period - std::round(360 / period)) < 0.02;
}

std::vector<double> starts_of(const Parameter& p) {
  std::vector<double> list;
  if (p.scale == Parameter::Scale::gear) {
    for (const double turn : {360.0, 180.0, 120.0, 90.0, 72.0, 60.0, 45.0, 36.0, 30.0}) list.push_back(turn);
    for (double v = 24; v > p.lower; v *= 0.965) list.push_back(v);
    return list;
  }
  for (int i = 0; i < p.starts; ++i) {
    const double x = p.starts > 1 ? static_cast<double>(i) / (p.starts - 1) : 0.5;
    list.push_back(p.logarithmic ? p.lower * std::pow(p.upper / p.lower, x)
                                 : p.lower + x * (p.upper - p.lower));
  }
  return list;
}

MeanModel::Fit evaluate(const MeanModel& model, const Term& term) {
  const Columns c = linear_columns(model, term);
  return MeanModel::solve(model.products(c.columns_mm), c.prior, true);
}

/// Frequencies (per mm) of the strongest waves along the range that have a comb's phase, strongest first.
std::vector<std::pair<double, double>> comb_lines(const std::vector<double>& range,
                                                  const std::vector<double>& score, double low, double high,
                                                  const Parameter& bins) {
  constexpr std::size_t kept = 24, most = std::size_t{1} << 20;
  const double step = bins.lower / 8;
  std::size_t size = 1024;
  while (size < most && static_cast<double>(size) * step < 4 * (high - low + bins.upper)) size *= 2;
  std::vector<double> grid(size, 0.0);
  for (std::size_t i = 0; i < range.size(); ++i) {
    const double at = (range[i] - low) / step;
    if (at + 1 < static_cast<double>(size)) grid[static_cast<std::size_t>(at + 0.5)] += score[i];
  }
  std::vector<std::complex<double>> spectrum;
  Eigen::FFT<double> transform;
  transform.fwd(spectrum, grid);
  std::vector<std::pair<double, double>> lines;
  const double least = 1 / (static_cast<double>(size) * step);
  for (std::size_t k = 1; k < size / 2; ++k) {
    const double frequency = static_cast<double>(k) * least;
    if (frequency < 1 / bins.upper || frequency > 1 / bins.lower) continue;
    // Rounding reads short just above a multiple of the bin: minus a sine.
    const double strength = std::imag(spectrum[k] * std::polar(1.0, -2 * pi * frequency * low));
    if (lines.size() == kept && strength <= lines.back().first) continue;
    lines.emplace_back(strength, frequency);
    std::ranges::sort(lines, std::greater<>());
    if (lines.size() > kept) lines.pop_back();
  }
  return lines;
}

/// A comb of bins fits only within a thousandth of its width, so tens of thousands are possible: those
/// whose first harmonic shows in the residual's spectrum along the range are tried by their plain
/// correlation, and the best of these are fitted.
std::vector<std::vector<double>> combs(const MeanModel& model, const Term& term, std::size_t bin_index) {
  const Parameter& p = term.mechanism->parameters[bin_index];
  const Eigen::VectorXd residual = model.residual();
  std::vector<double> range, score;
  double low = 1e300, high = 0;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    range.push_back(model.cell(i).sight.range_mm);
    score.push_back(residual[i] / std::pow(model.sigma_of_mean(i), 2));
    low = std::min(low, range.back());
    high = std::max(high, range.back());
  }
  const auto along = [&](double bin) {
    double sum = 0;
    for (std::size_t i = 0; i < range.size(); ++i)
      sum += score[i] * (bin * std::round(range[i] / bin) - range[i]);
    return sum / bin;
  };
  std::vector<std::pair<double, double>> lines = comb_lines(range, score, low, high, p);
  std::vector<std::pair<double, std::vector<double>>> tried;
  const double apart = 1 / (8 * (high - low + p.upper));  // of two frequencies within one line
  for (const auto& [strength, frequency] : lines)
    for (int k = -2; k <= 2; ++k) {
      const double bin = std::clamp(1 / (frequency + k * apart / 2), p.lower, p.upper);
      std::vector<double> values = term.values;
      values[bin_index] = bin;
      tried.emplace_back(along(bin), std::move(values));
    }
  const std::size_t keep = std::min<std::size_t>(6, tried.size());
  std::partial_sort(tried.begin(), tried.begin() + static_cast<std::ptrdiff_t>(keep), tried.end(),
                    [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<std::vector<double>> best;
  for (std::size_t i = 0; i < keep; ++i) best.push_back(tried[i].second);
  return best;
}

template <typename Attempt>
void refine(const std::vector<double>& start, const std::vector<std::size_t>& shapes, const Term& term,
            const Attempt& attempt) {
  const auto& parameters = term.mechanism->parameters;
  const auto n = static_cast<unsigned>(shapes.size());
  struct Context {
    const Attempt& attempt;
    std::vector<double> values;
    const std::vector<std::size_t>& shapes;
    const std::vector<Parameter>& parameters;
  } context{attempt, start, shapes, parameters};
  std::vector<double> x, lower, upper, first;
  for (const std::size_t k : shapes) {
    const Parameter& p = parameters[k];
    const auto in = [&](double v) { return p.logarithmic ? std::log(v) : v; };
    x.push_back(in(std::clamp(start[k], p.lower, p.upper)));
    lower.push_back(in(p.lower));
    upper.push_back(in(p.upper));
    first.push_back((upper.back() - lower.back()) / std::max(2, p.starts) / 2);
  }
  nlopt_opt optimiser = nlopt_create(NLOPT_LN_NELDERMEAD, n);
  nlopt_set_lower_bounds(optimiser, lower.data());
  nlopt_set_upper_bounds(optimiser, upper.data());
  nlopt_set_initial_step(optimiser, first.data());
  nlopt_set_maxeval(optimiser, 15 + 15 * static_cast<int>(n));
  nlopt_set_ftol_abs(optimiser, 0.02);
  nlopt_set_max_objective(
      optimiser,
      [](unsigned size, const double* at, double*, void* data) {
        auto& c = *static_cast<Context*>(data);
        std::vector<double> values = c.values;
        for (unsigned i = 0; i < size; ++i)
          values[c.shapes[i]] = c.parameters[c.shapes[i]].logarithmic ? std::exp(at[i]) : at[i];
        return c.attempt(values);
      },
      &context);
  double value = 0;
  nlopt_optimize(optimiser, x.data(), &value);
  nlopt_destroy(optimiser);
}

}  // namespace

Candidate look(const MeanModel& model, const Term& term, std::optional<double> spacing_deg) {
  const auto& parameters = term.mechanism->parameters;
  std::vector<std::size_t> shapes;
  for (std::size_t k = 0; k < parameters.size(); ++k)
    if (parameters[k].role == Role::shape) shapes.push_back(k);
  Candidate best;
  best.term = term;
  std::vector<std::pair<double, std::vector<double>>> tried;
  const auto attempt = [&](const std::vector<double>& values) {
    Term t = term;
    t.values = values;
    if (!possible(*t.mechanism, values, spacing_deg)) return -1e300;
    const MeanModel::Fit f = evaluate(model, t);
    set_coefficients(t, f.value, f.sigma.cwiseAbs2().asDiagonal());
    const double evidence = f.evidence - odds::against(t);
    if (evidence > best.evidence) {
      best.evidence = evidence;
      best.gain = f.gain;
      best.term = t;
    }
    return evidence;
  };
  std::vector<std::vector<double>> grids{term.values};
  if (const auto bin = term.mechanism->parameter_of(Parameter::Scale::bin))
    grids = combs(model, term, *bin);
  else
    for (const std::size_t k : shapes) {
      std::vector<std::vector<double>> more;
      for (const auto& values : grids)
        for (const double v : starts_of(parameters[k])) {
          more.push_back(values);
          more.back()[k] = v;
        }
      grids = std::move(more);
    }
  for (const auto& values : grids) tried.emplace_back(attempt(values), values);
  if (!shapes.empty() && best.gain > 3) {
    std::ranges::sort(tried, [](const auto& a, const auto& b) { return a.first > b.first; });
    for (std::size_t s = 0; s < std::min<std::size_t>(2, tried.size()); ++s)
      if (tried[s].first > tried[0].first - 8) refine(tried[s].second, shapes, term, attempt);
  }
  for (const std::size_t k : shapes)
    best.evidence -= odds::against_place(best.gain, places_of(parameters[k]));
  if (term.mechanism->one_target)
    best.evidence -= std::log(static_cast<double>(model.bench().targets.size()));
  return best;
}

Candidate look(const MeanModel& model, Shape shape) {
  Candidate best;
  const double price = shape.price;
  shape.size = 1;
  const Columns unit = columns_of(model, shape);
  const MeanModel::Products products = model.products(unit.columns_mm);
  if (products.square.trace() < 1e-9) return best;
  for (double size : {0.1, 0.3, 1.0, 3.0, 10.0, 30.0}) {
    if (shape.channel != Channel::range) size *= 0.02 * rad_per_deg;
    Prior prior = unit.prior;
    prior.sigma *= size;
    const MeanModel::Fit f = MeanModel::solve(products, prior, false);
    if (f.evidence - price <= best.evidence) continue;
    best.evidence = f.evidence - price;
    best.gain = f.gain;
    shape.size = size;
    best.shape = shape;
  }
  return best;
}

}  // namespace fit::explain
