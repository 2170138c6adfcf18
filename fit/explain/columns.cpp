// SPDX-License-Identifier: MIT
#include "fit/explain/columns.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/unnamed.hpp"

namespace fit::explain {
namespace {

using Role = Parameter::Role;

bool acts_on(const Term& term, const Cell& cell) { return term.target < 0 || cell.at.target == term.target; }

Eigen::VectorXd effect_column(const MeanModel& model, const Term& term, const std::vector<double>& values) {
  Eigen::VectorXd column(model.rows());
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const Cell& cell = model.cell(i);
    column[i] = acts_on(term, cell) ? model.shift(i, term.mechanism->act(cell.at, values)) : 0;
    if (!std::isfinite(column[i])) column[i] = 0;
  }
  return column;
}

/// Derivative by a size of what moves its target: that stands where it was moved to already.
Eigen::VectorXd slope_column(const MeanModel& model, const Term& term, std::size_t size) {
  const double step = 0.02 * term.mechanism->parameters[size].typical;
  std::vector<double> above(term.values.size(), 0.0), below = above;
  above[size] = step;
  below[size] = -step;
  return (effect_column(model, term, above) - effect_column(model, term, below)) / (2 * step);
}

/// Values with all sizes zero.
std::vector<double> only_shapes(const Term& term) {
  std::vector<double> values = term.values;
  for (std::size_t k = 0; k < values.size(); ++k)
    if (term.mechanism->parameters[k].role != Role::shape) values[k] = 0;
  return values;
}

}  // namespace

double lever_of(Channel channel, const Sight& sight) {
  return channel == Channel::range        ? 1
         : channel == Channel::beam_angle ? sight.beam_lever()
                                          : sight.stage_lever();
}

Eigen::VectorXd effect_of(const MeanModel& model, const Term& term) {
  return effect_column(model, term, term.values);
}

double coordinate_at(const MeanModel& model, Coordinate coordinate, Eigen::Index row) {
  return value_of(coordinate, model.cell(row), model.group(row));
}

Eigen::VectorXd scaled_coordinate(const MeanModel& model, Coordinate coordinate) {
  const Eigen::Index n = model.rows();
  Eigen::VectorXd x(n);
  for (Eigen::Index i = 0; i < n; ++i) x[i] = coordinate_at(model, coordinate, i);
  double low = 1e300, high = -1e300;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (!std::isfinite(x[i])) continue;
    low = std::min(low, x[i]);
    high = std::max(high, x[i]);
  }
  if (!(high > low)) return Eigen::VectorXd::Zero(n);
  const bool uneven = coordinate == Coordinate::intensity || coordinate == Coordinate::range;
  if (!uneven) {
    for (Eigen::Index i = 0; i < n; ++i) x[i] = std::isfinite(x[i]) ? 2 * (x[i] - low) / (high - low) - 1 : 0;
    return x;
  }
  // Half rank, half value: neither a crowd of bright cells nor a lonely dark one takes all the room.
  constexpr int bins = 256;
  std::vector<double> count(bins + 1, 0.0);
  const auto bin = [&](double v) {
    return std::clamp(static_cast<int>((v - low) / (high - low) * bins), 0, bins - 1);
  };
  double all = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (!std::isfinite(x[i])) continue;
    count[static_cast<std::size_t>(bin(x[i])) + 1] += 1;
    all += 1;
  }
  for (std::size_t b = 1; b < count.size(); ++b) count[b] += count[b - 1];
  for (Eigen::Index i = 0; i < n; ++i) {
    if (!std::isfinite(x[i])) {
      x[i] = 0;
      continue;
    }
    const double place = (x[i] - low) / (high - low) * bins;
    const auto b = static_cast<std::size_t>(bin(x[i]));
    const double rank = (count[b] + (count[b + 1] - count[b]) * (place - static_cast<double>(b))) / all;
    x[i] = rank + (x[i] - low) / (high - low) - 1;
  }
  return x;
}

void add(Columns& all, const Columns& more) {
  const Eigen::Index had = all.columns_mm.cols(), plus = more.columns_mm.cols();
  if (plus == 0) return;
  if (had == 0) {
    all = more;
    return;
  }
  all.columns_mm.conservativeResize(Eigen::NoChange, had + plus);
  all.columns_mm.rightCols(plus) = more.columns_mm;
  all.prior.mean.conservativeResize(had + plus);
  all.prior.mean.tail(plus) = more.prior.mean;
  all.prior.sigma.conservativeResize(had + plus);
  all.prior.sigma.tail(plus) = more.prior.sigma;
}

std::vector<double> linear_coefficients(const Term& term) {
  std::vector<double> list;
  const auto& parameters = term.mechanism->parameters;
  for (std::size_t k = 0; k < parameters.size(); ++k) {
    if (parameters[k].role != Role::size) continue;
    if (has_phase(*term.mechanism, k)) {
      list.push_back(term.values[k] * std::cos(term.values[k + 1] * rad_per_deg));
      list.push_back(term.values[k] * std::sin(term.values[k + 1] * rad_per_deg));
    } else {
      list.push_back(term.values[k]);
    }
  }
  return list;
}

void set_coefficients(Term& term, const Eigen::VectorXd& x, const Eigen::MatrixXd& covariance) {
  const auto& parameters = term.mechanism->parameters;
  term.sigma.assign(parameters.size(), 0.0);
  Eigen::Index at = 0;
  for (std::size_t k = 0; k < parameters.size(); ++k) {
    if (parameters[k].role != Role::size) continue;
    if (!has_phase(*term.mechanism, k)) {
      term.values[k] = x[at];
      term.sigma[k] = std::sqrt(std::max(0.0, covariance(at, at)));
      ++at;
      continue;
    }
    const double size = std::hypot(x[at], x[at + 1]);
    term.values[k] = size;
    term.values[k + 1] = std::atan2(x[at + 1], x[at]) * deg_per_rad;
    if (size > 0) {
      const Eigen::Vector2d out(x[at] / size, x[at + 1] / size), across(-out.y(), out.x());
      const Eigen::Matrix2d c = covariance.block<2, 2>(at, at);
      term.sigma[k] = std::sqrt(std::max(0.0, out.dot(c * out)));
      term.sigma[k + 1] =
          std::min(180.0, std::sqrt(std::max(0.0, across.dot(c * across))) / size * deg_per_rad);
    }
    at += 2;
  }
  for (std::size_t k = 0; k < parameters.size(); ++k) {
    const Parameter& p = parameters[k];
    if (p.role != Role::shape || at >= x.size()) continue;
    const double u = std::sqrt(std::max(0.0, covariance(at, at)));
    const double moved =
        p.logarithmic ? term.values[k] * std::exp(std::clamp(x[at], -0.3, 0.3)) : term.values[k] + x[at];
    term.values[k] = std::clamp(moved, p.lower, p.upper);
    term.sigma[k] = p.logarithmic ? term.values[k] * std::min(u, 2.0) : u;
    ++at;
  }
}

Columns linear_columns(const MeanModel& model, const Term& term) {
  const auto& parameters = term.mechanism->parameters;
  std::vector<Eigen::VectorXd> list;
  std::vector<double> mean, sigma;
  for (std::size_t k = 0; k < parameters.size(); ++k) {
    if (parameters[k].role != Role::size) continue;
    std::vector<double> values = only_shapes(term);
    values[k] = 1;
    list.push_back(term.mechanism->displaces ? slope_column(model, term, k)
                                             : effect_column(model, term, values));
    mean.push_back(parameters[k].expected);
    sigma.push_back(parameters[k].typical);
    if (!has_phase(*term.mechanism, k)) continue;
    values[k + 1] = 90;
    list.push_back(effect_column(model, term, values));
    mean.push_back(0);
    sigma.push_back(parameters[k].typical);
  }
  Columns c;
  c.columns_mm.resize(model.rows(), static_cast<Eigen::Index>(list.size()));
  c.prior.mean = Eigen::Map<Eigen::VectorXd>(mean.data(), static_cast<Eigen::Index>(mean.size()));
  c.prior.sigma = Eigen::Map<Eigen::VectorXd>(sigma.data(), static_cast<Eigen::Index>(sigma.size()));
  for (std::size_t j = 0; j < list.size(); ++j) c.columns_mm.col(static_cast<Eigen::Index>(j)) = list[j];
  return c;
}

bool has_phase(const Mechanism& mechanism, std::size_t size) {
  return size + 1 < mechanism.parameters.size() && mechanism.parameters[size + 1].role == Role::phase;
}

bool is_comb(const Mechanism& mechanism) { return mechanism.parameter_of(Parameter::Scale::bin).has_value(); }

/// Millimetres by which a bin may change before its comb is another one: a quarter of a bin over the ranges
/// seen. Less would count beams at the edges of bins, whose ranges are not known so well.
static double step_of_comb(const MeanModel& model, double bin_mm) {
  double low = 1e300, high = 0;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    low = std::min(low, model.cell(i).sight.range_mm);
    high = std::max(high, model.cell(i).sight.range_mm);
  }
  return 0.25 * bin_mm * bin_mm / std::max(bin_mm, high - low);
}

Columns shape_columns(const MeanModel& model, const Term& term) {
  Columns c;
  const auto& parameters = term.mechanism->parameters;
  for (std::size_t k = 0; k < parameters.size(); ++k) {
    const Parameter& p = parameters[k];
    if (p.role != Role::shape) continue;
    const double part = 1e-3;
    const double step = is_comb(*term.mechanism) ? step_of_comb(model, term.values[k])
                        : p.logarithmic          ? part
                                                 : part * (p.upper - p.lower);
    std::vector<double> above = term.values, below = term.values;
    above[k] = p.logarithmic ? above[k] * std::exp(step) : above[k] + step;
    below[k] = p.logarithmic ? below[k] * std::exp(-step) : below[k] - step;
    Columns one;
    one.columns_mm = (effect_column(model, term, above) - effect_column(model, term, below)) / (2 * step);
    const double span = p.logarithmic ? std::log(p.upper / p.lower) : p.upper - p.lower;
    one.prior.mean = Eigen::VectorXd::Zero(1);
    one.prior.sigma = Eigen::VectorXd::Constant(1, span / std::sqrt(12.0));
    add(c, one);
  }
  return c;
}

/// The freedom of an effect whose curve differs from device to device, along its coordinate.
static Columns bends(const MeanModel& model, const Term& term, const Eigen::VectorXd& effect_mm) {
  const double count = std::max(1.0, static_cast<double>(effect_mm.size())), mean = effect_mm.sum() / count,
               rms = std::sqrt(effect_mm.squaredNorm() / count);
  if (!(rms > std::abs(mean))) return {};
  Shape curve;
  curve.form = find_form("smooth");
  curve.coordinate = term.mechanism->coordinate;
  curve.length = 0.5;
  curve.size = term.mechanism->formula_error * std::sqrt(rms * rms - mean * mean);
  Columns c = columns_of(model, curve);
  // They fade out as the effect does itself: what shows only where it has gone is something else.
  for (Eigen::Index k = 0; k < c.columns_mm.cols(); ++k)
    c.columns_mm.col(k).array() *= effect_mm.array().abs() / rms;
  // At which of its values the instrument was set to read right nobody knows.
  Columns set_right;
  set_right.columns_mm = Eigen::MatrixXd::Ones(model.rows(), 1);
  set_right.prior.mean = Eigen::VectorXd::Zero(1);
  set_right.prior.sigma = Eigen::VectorXd::Constant(1, rms);
  add(c, set_right);
  return c;
}

/// Before its first move a stage rests anywhere within its play; one column, if it came from either side
/// afterwards.
static Columns place_in_play(const MeanModel& model, const Term& term) {
  Columns c;
  Eigen::VectorXd column = Eigen::VectorXd::Zero(model.rows());
  bool forward = false, backward = false, unknown = false;
  for (Eigen::Index i = 0; i < model.rows(); ++i) {
    const Cell& cell = model.cell(i);
    forward = forward || cell.at.approach > 0;
    backward = backward || cell.at.approach < 0;
    if (cell.at.approach != 0) continue;
    unknown = true;
    Circumstances at = cell.at;
    at.approach = 1;
    column[i] = model.shift(i, term.mechanism->act(at, term.values));
  }
  if (!forward || !backward || !unknown) return c;
  c.columns_mm = column;
  c.prior.mean = Eigen::VectorXd::Zero(1);
  c.prior.sigma = Eigen::VectorXd::Constant(1, 1 / std::sqrt(3.0));  // anywhere, from one side to the other
  return c;
}

Columns freedom_columns(const MeanModel& model, const Term& term) {
  Columns c;
  const Mechanism& mechanism = *term.mechanism;
  const double formula_error = mechanism.formula_error;
  const Coordinate coordinate = mechanism.coordinate;
  if (coordinate == Coordinate::approach) return place_in_play(model, term);
  if (formula_error <= 0 || mechanism.one_target || coordinate == Coordinate::stage_rate) return c;
  const bool corner = coordinate == Coordinate::target;
  if (mechanism.parameters.size() == 1 && corner) return c;  // an offset has no shape
  const Eigen::Index n = model.rows();
  Eigen::VectorXd x;
  if (corner) {
    x.resize(n);
    for (Eigen::Index i = 0; i < n; ++i)
      x[i] = std::exp(-std::min(1e4, model.cell(i).at.corner_mm) / 300) * 2 - 1;
  } else {
    x = scaled_coordinate(model, coordinate);
  }
  // Typical size of the effect in each way it works.
  Eigen::VectorXd whole(n), even(n);
  double range2 = 0, beam2 = 0, stage2 = 0, count = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    const Cell& cell = model.cell(i);
    whole[i] = 0;
    if (!acts_on(term, cell)) continue;
    const Effect e = mechanism.act(cell.at, term.values);
    whole[i] = model.shift(i, e);
    range2 += e.range_mm * e.range_mm;
    beam2 += e.beam_rad * e.beam_rad;
    stage2 += e.stage_rad * e.stage_rad;
    count += 1;
  }
  count = std::max(1.0, count);
  const double range = std::sqrt(range2 / count), beam = std::sqrt(beam2 / count),
               stage = std::sqrt(stage2 / count);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Sight& sight = model.cell(i).sight;
    even[i] = range + sight.beam_lever() * beam + sight.stage_lever() * stage;
  }
  if (mechanism.any_curve) return bends(model, term, whole);
  const bool harmonic =
      std::ranges::any_of(mechanism.parameters, [](const Parameter& p) { return p.role == Role::phase; });
  std::vector<Eigen::VectorXd> list;
  std::vector<double> share;
  if (!harmonic) {
    Eigen::VectorXd before = Eigen::VectorXd::Ones(n), now = x;  // Legendre polynomials
    list.push_back(even);
    share.push_back(formula_error / 2);
    for (int k = 1; k <= 5; ++k) {
      list.push_back(even.cwiseProduct(now));
      share.push_back(formula_error / (1 + 0.5 * k));
      const Eigen::VectorXd next = ((2 * k + 1) * x.cwiseProduct(now) - k * before) / (k + 1);
      before = now;
      now = next;
    }
  } else {
    list.push_back(whole.cwiseProduct(x));
    share.push_back(formula_error);
    list.push_back(whole.cwiseProduct(x.cwiseProduct(x)));
    share.push_back(formula_error);
    std::vector<double> values = term.values;
    for (std::size_t k = 0; k < values.size(); ++k)
      if (mechanism.parameters[k].name.starts_with("period")) values[k] /= 2;
    if (values != term.values) {
      for (std::size_t k = 0; k + 1 < values.size(); ++k) {
        if (mechanism.parameters[k + 1].role != Role::phase) continue;
        for (const double phase : {0.0, 90.0}) {
          values[k + 1] = phase;
          list.push_back(effect_column(model, term, values));
          share.push_back(1.5 * formula_error);
        }
      }
    } else if (coordinate == Coordinate::beam) {
      // A disk far off its axis bends angles by atan2(e sin, 1 - e cos): a little of twice the angle.
      for (const double phase : {0.0, pi / 2}) {
        Eigen::VectorXd second(n);
        for (Eigen::Index i = 0; i < n; ++i) {
          const Cell& cell = model.cell(i);
          second[i] = cell.sight.beam_lever() * beam * std::sin(3 * cell.beam_rad + phase);
        }
        list.push_back(second);
        share.push_back(formula_error / 2);
      }
    }
  }
  c.columns_mm.resize(n, static_cast<Eigen::Index>(list.size()));
  c.prior.mean = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(list.size()));
  c.prior.sigma = c.prior.mean;
  for (std::size_t j = 0; j < list.size(); ++j) {
    c.columns_mm.col(static_cast<Eigen::Index>(j)) = list[j];
    c.prior.sigma[static_cast<Eigen::Index>(j)] = share[j];
  }
  return c;
}

}  // namespace fit::explain
