// SPDX-License-Identifier: MIT
#include "fit/explain/model/term.hpp"

#include <algorithm>
#include <cmath>

namespace fit::explain::model {

using Eigen::Index;
using Role = Parameter::Role;

namespace {

bool acts_there(const Kind& kind, const Circumstances& at) {
  return kind.target < 0 || at.target == kind.target;
}

/// On average over the cells that are taken together in a row: a comb may have other teeth there, and a piece
/// of a target begins and ends.
Effect over_cells(const Kind& kind, Circumstances at, std::span<const CellOfRow> cells,
                  const std::vector<double>& values) {
  Effect mean;  // neither changes anything but ranges
  for (const CellOfRow& cell : cells) {
    at.range_mm = cell.range_mm;
    at.along_mm = cell.along_mm;
    mean.range_mm += kind.mechanism->act(at, values).range_mm;
  }
  mean.range_mm /= static_cast<double>(cells.size());
  return mean;
}

/// Values with all sizes zero but one.
std::vector<double> with_only(const Kind& kind, std::vector<double> values, const Coefficient& c,
                              double size) {
  const auto& parameters = kind.mechanism->parameters;
  for (std::size_t k = 0; k < parameters.size(); ++k)
    if (parameters[k].role != Role::shape) values[k] = 0;
  values[c.parameter] = size;
  if (c.quadrature) values[c.parameter + 1] = 90;
  return values;
}

/// A size to differentiate at: the present one, where there is one.
double size_at(const Coefficient& c, double now) {
  constexpr double hardly_any = 0.02;
  const double least = hardly_any * std::pow(c.typical, 1.0 / c.power);
  return std::abs(now) > least ? now : least;
}

Eigen::MatrixXd columns_of_form(const Rows& channel, const Kind& kind, const std::vector<double>& values) {
  const auto count = static_cast<Index>(kind.coefficients.size());
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(channel.rows(), count);
  Eigen::VectorXd each(count), size(count);
  for (Index k = 0; k < count; ++k)
    size[k] = size_at(kind.coefficients[static_cast<std::size_t>(k)], values[static_cast<std::size_t>(k)]);
  for (Index i = 0; i < channel.rows(); ++i) {
    if (!acts_there(kind, channel.at(i))) continue;
    each.setZero();
    kind.functions->at(channel.at(i), values, each);
    for (Index k = 0; k < count; ++k) {
      Effect effect;
      effect.*kind.functions->changes = size[k] * each[k];
      const double response = channel.response(i, effect);
      if (std::isfinite(response)) columns(i, k) = response / size[k];
    }
  }
  return columns;
}

/// Of the logarithm of a bin, before its comb is another one: a quarter of a bin over the ranges seen.
double step_of_comb(const Rows& channel, double bin_mm) {
  Extent ranges;
  for (Index i = 0; i < channel.rows(); ++i) ranges.add(channel.at(i).range_mm);
  return 0.25 * bin_mm / std::max(bin_mm, ranges.length());
}

}  // namespace

Effect effect_at(const Rows& channel, Index row, const Kind& kind, const std::vector<double>& values) {
  const std::span<const CellOfRow> cells = channel.cells_of(row);
  const std::span<const double> times_s = channel.times_s(row);
  if (kind.differs_within_rows() && !cells.empty()) return over_cells(kind, channel.at(row), cells, values);
  Effect effect = kind.mechanism->act(channel.at(row), values);
  if (times_s.empty() || effect.stage_rad == 0) return effect;
  Circumstances at = channel.at(row);
  double sum = 0, squares = 0;
  for (const double time_s : times_s) {
    at.since_move_s = time_s;
    const double angle_rad = kind.mechanism->act(at, values).stage_rad;
    sum += angle_rad;
    squares += angle_rad * angle_rad;
  }
  const auto n = static_cast<double>(times_s.size());
  effect.scan_angle_variance_rad2 += std::max(0.0, squares / n - sum * sum / (n * n));
  return effect;
}

Eigen::VectorXd effect_of(const Rows& channel, const Kind& kind, const std::vector<double>& values) {
  Eigen::VectorXd column = Eigen::VectorXd::Zero(channel.rows());
  const Circumstances* before = nullptr;  // two statistics of the same scan have the same circumstances
  Effect effect;
  for (Index i = 0; i < channel.rows(); ++i) {
    const Circumstances& at = channel.at(i);
    if (!acts_there(kind, at)) continue;
    if (!before || kind.differs_within_rows() || !(at == *before))
      effect = effect_at(channel, i, kind, values);
    before = &at;
    const double response = channel.response(i, effect);
    if (std::isfinite(response)) column[i] = response;
  }
  return column;
}

std::vector<Coefficient> coefficients_of(const Mechanism& mechanism,
                                         const std::function<int(std::size_t size)>& power_of) {
  std::vector<Coefficient> list;
  const auto& parameters = mechanism.parameters;
  for (std::size_t k = 0; k < parameters.size(); ++k) {
    const Parameter& p = parameters[k];
    if (p.role != Role::size) continue;
    const int power = power_of(k);
    Coefficient c;
    c.parameter = k;
    c.has_phase = k + 1 < parameters.size() && parameters[k + 1].role == Role::phase;
    c.power = power;
    c.expected = std::pow(p.expected, power);
    c.typical = std::pow(p.typical, power);
    c.largest = std::pow(p.largest, power);
    c.sign = c.has_phase ? 0 : power == 2 ? 1 : p.sign;
    list.push_back(c);
    if (!c.has_phase) continue;
    c.quadrature = 1;
    list.push_back(c);
  }
  return list;
}

Eigen::VectorXd coefficients(const Term& term) {
  const auto& list = term.kind->coefficients;
  Eigen::VectorXd values(static_cast<Index>(list.size()));
  for (std::size_t k = 0; k < list.size(); ++k) {
    const double size = std::pow(term.values[list[k].parameter], list[k].power);
    const double phase = list[k].has_phase ? term.values[list[k].parameter + 1] * rad_per_deg : 0;
    values[static_cast<Index>(k)] = size * (list[k].quadrature ? std::sin(phase) : std::cos(phase));
  }
  return values;
}

void set_coefficients(Term& term, const Eigen::VectorXd& value, const Eigen::MatrixXd& covariance) {
  const auto& list = term.kind->coefficients;
  term.sigma.resize(term.values.size(), 0.0);
  for (Index k = 0; k < value.size(); ++k) {
    const Coefficient& c = list[static_cast<std::size_t>(k)];
    double& size = term.values[c.parameter];
    double& u = term.sigma[c.parameter];
    if (c.quadrature) continue;
    if (c.has_phase) {
      size = std::hypot(value[k], value[k + 1]);
      const Eigen::Vector2d out =
          size > 0 ? Eigen::Vector2d(value[k] / size, value[k + 1] / size) : Eigen::Vector2d::UnitX();
      const Eigen::Vector2d across(-out.y(), out.x());
      const Eigen::Matrix2d part = covariance.block<2, 2>(k, k);
      u = std::sqrt(std::max(0.0, out.dot(part * out)));
      term.values[c.parameter + 1] = std::atan2(value[k + 1], value[k]) * deg_per_rad;
      term.sigma[c.parameter + 1] = std::min(
          180.0, std::sqrt(std::max(0.0, across.dot(part * across))) / std::max(1e-12, size) * deg_per_rad);
    } else if (c.power == 2) {
      size = std::sqrt(std::max(0.0, value[k]));
      const double u2 = std::sqrt(std::max(0.0, covariance(k, k)));
      u = size > 0 ? std::min(u2 / (2 * size), std::sqrt(u2)) : std::sqrt(u2);
    } else {
      size = value[k];
      u = std::sqrt(std::max(0.0, covariance(k, k)));
    }
  }
}

std::vector<std::size_t> shapes_of(const Kind& kind) {
  std::vector<std::size_t> list;
  const auto& parameters = kind.mechanism->parameters;
  for (std::size_t k = 0; k < parameters.size(); ++k)
    if (parameters[k].role == Role::shape && parameters[k].upper > parameters[k].lower &&
        parameters[k].starts > 0 && !is_always(parameters[k].expected) &&
        !(kind.is_plain && parameters[k].generalises))
      list.push_back(k);
  return list;
}

std::vector<std::size_t> refined_shapes_of(const Kind& kind) {
  if (!kind.refines) return {};
  std::vector<std::size_t> list = shapes_of(kind);
  std::erase_if(
      list, [&](std::size_t k) { return kind.mechanism->parameters[k].scale == Parameter::Scale::choice; });
  return list;
}

Eigen::MatrixXd columns_of(const Rows& channel, const Kind& kind, const std::vector<double>& values,
                           const Kind::Acting* acting) {
  if (kind.functions && !kind.differs_within_rows()) return columns_of_form(channel, kind, values);
  Eigen::MatrixXd columns =
      Eigen::MatrixXd::Zero(channel.rows(), static_cast<Index>(kind.coefficients.size()));
  for (std::size_t k = 0; k < kind.coefficients.size(); ++k) {
    if (acting && !acting->sizes[k]) continue;
    const Coefficient& c = kind.coefficients[k];
    auto column = columns.col(static_cast<Index>(k));
    if (kind.mechanism->displaces) {  // Stands already where it was moved to.
      const double small = size_at(c, 0);
      column = (effect_of(channel, kind, with_only(kind, values, c, small)) -
                effect_of(channel, kind, with_only(kind, values, c, -small))) /
               2 / small;
    } else {
      const double size = size_at(c, values[c.parameter]);
      column = effect_of(channel, kind, with_only(kind, values, c, size));
      if (acting ? acting->without_size : kind.acts_without_size)
        column -= effect_without_size(channel, kind, values);
      column /= std::pow(size, c.power);
    }
  }
  return columns;
}

void follow(Term& term, double farther) {
  if (!term.kind->bins || term.kind->is_plain) return;
  double& zero = term.values[*term.kind->bins + 1];
  zero -= farther / term.values[*term.kind->bins];
  zero -= std::floor(zero);
}

std::vector<double> without_size(const Kind& kind, std::vector<double> values) {
  for (std::size_t k = 0; k < values.size(); ++k)
    if (kind.mechanism->parameters[k].role == Role::size) values[k] = 0;
  return values;
}

Eigen::VectorXd effect_without_size(const Rows& channel, const Kind& kind,
                                    const std::vector<double>& values) {
  return effect_of(channel, kind, without_size(kind, values));
}

Eigen::MatrixXd shape_columns(const Rows& channel, const Term& term) {
  const std::vector<std::size_t> shapes = refined_shapes_of(*term.kind);
  Eigen::MatrixXd columns(channel.rows(), static_cast<Index>(shapes.size()));
  for (std::size_t j = 0; j < shapes.size(); ++j) {
    const Parameter& p = term.kind->mechanism->parameters[shapes[j]];
    constexpr double small = 1e-3, of_zero = 0.125;
    const double step = term.kind->bins == shapes[j] ? step_of_comb(channel, term.values[shapes[j]])
                        : term.kind->bins            ? of_zero
                                                     : small;
    std::vector<double> above = term.values, below = term.values;
    double &a = above[shapes[j]], &b = below[shapes[j]];
    const double span = p.logarithmic ? std::log(p.upper / p.lower) : p.upper - p.lower;
    a = p.logarithmic ? a * std::exp(step) : a + step * span;
    b = p.logarithmic ? b * std::exp(-step) : b - step * span;
    const double width = 2 * step * (p.logarithmic ? 1 : span), deviation = span / std::sqrt(12.0);
    columns.col(static_cast<Index>(j)) =
        (effect_of(channel, *term.kind, above) - effect_of(channel, *term.kind, below)) / width * deviation;
  }
  return columns;
}

double coordinate_of(Coordinate coordinate, const Circumstances& at) {
  switch (coordinate) {
    // clang-format off
    case Coordinate::beam: return at.beam_rad * deg_per_rad;
    case Coordinate::stage: return at.stage_rad * deg_per_rad;
    case Coordinate::range: return at.range_mm;
    case Coordinate::intensity: return at.intensity;
    case Coordinate::incidence: return at.incidence_rad * deg_per_rad;
    case Coordinate::edge_distance: return at.edge_rad * deg_per_rad;
    case Coordinate::time: return at.time_s;
    case Coordinate::temperature: return at.temperature_k;
    case Coordinate::approach: return at.approach;
    case Coordinate::stage_rate: return at.stage_rate_rad_s * deg_per_rad;
    case Coordinate::scan_seq: return at.seq;
    case Coordinate::target: return at.target;
    case Coordinate::range_rate: return at.range_mm * std::tan(at.incidence_rad);
      // clang-format on
  }
  return 0;
}

double place_of(Coordinate coordinate, int target, const Circumstances& at) {
  if (target == all_targets)
    return at.target + std::clamp(0.5 + at.along_mm / (2 * std::max(1.0, at.half_length_mm)), 0.0, 0.999);
  if (target >= 0 && at.target != target) return std::nan("");
  return coordinate == Coordinate::target && target >= 0 ? at.along_mm : coordinate_of(coordinate, at);
}

}  // namespace fit::explain::model
