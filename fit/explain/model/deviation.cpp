// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "fit/explain/model/term.hpp"
#include "fit/explain/numbers.hpp"
#include "fit/explain/reduction/temperature.hpp"

namespace fit::explain::model {
namespace {

using Eigen::Index;

/// A coordinate scaled to -1 .. 1 over the rows; along a target, by the distance to its corner.
Eigen::VectorXd scaled(const Rows& channel, Coordinate coordinate) {
  constexpr double reach_of_corners_mm = 300;
  Eigen::VectorXd x(channel.rows());
  Extent all;
  for (Index i = 0; i < x.size(); ++i) {
    const Circumstances& at = channel.at(i);
    x[i] = coordinate == Coordinate::target ? std::exp(-std::min(1e4, at.corner_mm) / reach_of_corners_mm)
           : coordinate == Coordinate::intensity
               ? std::log(std::max(1.0, at.intensity))  // as pulses on a threshold have it
               : coordinate_of(coordinate, at);
    all.add(x[i]);
  }
  for (double& v : x) v = std::isfinite(v) && all.length() > 0 ? 2 * (v - all.low) / all.length() - 1 : 0;
  return x;
}

/// Root mean square of an effect in each of its ways, over the rows; about its mean where a constant of any
/// size stands beside it.
Effect typical_of(const Rows& channel, const Term& term) {
  Effect rms;
  double count = 0, sum_mm = 0;
  for (Index i = 0; i < channel.rows(); ++i) {
    const Circumstances& at = channel.at(i);
    if (term.kind->target >= 0 && at.target != term.kind->target) continue;
    const Effect e = term.kind->mechanism->act(at, term.values);
    for (const auto way : ways_to_act()) rms.*way += e.*way * e.*way;
    sum_mm += e.range_mm;
    count += 1;
  }
  if (term.kind->mechanism->set_right_mm && count > 0)
    rms.range_mm = std::max(0.0, rms.range_mm - sum_mm * sum_mm / count);
  for (const auto way : ways_to_act()) rms.*way = std::sqrt(rms.*way / std::max(1.0, count));
  return rms;
}

/// An effect in units of its typical size.
double ratio(const Effect& e, const Effect& typical) {
  for (const auto way : ways_to_act())
    if (typical.*way > 0) return e.*way / (typical.*way);
  return 0;
}

/// Before its first move a stage rests anywhere within its play.
Eigen::MatrixXd place_in_play(const Rows& channel, const Term& term) {
  Eigen::MatrixXd column = Eigen::MatrixXd::Zero(channel.rows(), 1);
  for (Index i = 0; i < channel.rows(); ++i) {
    Circumstances at = channel.at(i);
    if (at.approach != 0) continue;
    at.approach = 1;
    column(i, 0) = channel.response(i, term.kind->mechanism->act(at, term.values)) / std::sqrt(3.0);
  }
  return column;
}

/// How warm a housing was that nobody read: what the others are compared with may lie aside.
Eigen::MatrixXd of_unread(const Rows& channel, const Term& term, Eigen::MatrixXd columns) {
  const Mechanism& m = *term.kind->mechanism;
  Eigen::VectorXd aside(channel.rows());
  bool is_known = true;
  for (Index i = 0; i < channel.rows(); ++i) {
    Circumstances at = channel.at(i);
    if (std::isfinite(at.temperature_k)) {
      const double here = channel.response(i, m.act(at, term.values));
      at.temperature_k += u_unread_k;
      aside[i] = channel.response(i, m.act(at, term.values)) - here;
      continue;
    }
    aside[i] = 0;
    columns.row(i).setZero();
    is_known = false;
  }
  if (is_known) return columns;
  columns.conservativeResize(Eigen::NoChange, columns.cols() + 1);
  columns.rightCols(1) = aside;
  return columns;
}

/// Where on its coordinate the instrument was set to read right.
Eigen::MatrixXd with_zero_elsewhere(const Rows& channel, const Term& term, Eigen::MatrixXd columns) {
  const Mechanism& m = *term.kind->mechanism;
  if (!m.set_right_mm) return columns;
  columns.conservativeResize(Eigen::NoChange, columns.cols() + 1);
  const Effect aside{.range_mm = m.set_right_mm(term.values)};
  for (Index i = 0; i < channel.rows(); ++i) columns(i, columns.cols() - 1) = channel.response(i, aside);
  return columns;
}

/// Its values with all phases a quarter of a turn ahead.
std::vector<double> quarter_ahead(const Term& term) {
  std::vector<double> ahead = term.values;
  const auto& parameters = term.kind->mechanism->parameters;
  for (std::size_t k = 0; k < ahead.size(); ++k)
    if (parameters[k].role == Parameter::Role::phase) ahead[k] += 90;
  return ahead;
}

/// A wave may swell and shift along its coordinate, and hold a second harmonic.
Eigen::MatrixXd of_wave(const Rows& channel, const Term& term, const Eigen::VectorXd& x, double share) {
  const Effect typical = typical_of(channel, term);
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(channel.rows(), 6);
  const std::vector<double> ahead = quarter_ahead(term);
  for (Index i = 0; i < channel.rows(); ++i) {
    const Circumstances& at = channel.at(i);
    const Effect e = term.kind->mechanism->act(at, term.values), q = term.kind->mechanism->act(at, ahead);
    const double along = channel.response(i, e), across = channel.response(i, q), g = ratio(e, typical);
    columns.row(i) << along * x[i], along * x[i] * x[i], across * x[i], across * x[i] * x[i], along * g,
        across * g;
  }
  return share * columns;
}

/// Every corner sends back another share of the light, and along all of them it may fade in another way: both
/// in proportion to the effect.
Eigen::MatrixXd of_corners(const Rows& channel, const Term& term) {
  const Eigen::VectorXd x = scaled(channel, Coordinate::target);
  const Mechanism& m = *term.kind->mechanism;
  std::map<std::pair<int, bool>, Index> corners;
  for (Index i = 0; i < channel.rows(); ++i) {
    const Circumstances& at = channel.at(i);
    if (std::isfinite(at.corner_mm)) corners.try_emplace({at.target, at.along_mm > 0}, std::ssize(corners));
  }
  constexpr int cosines = 2;
  const Index shares = std::ssize(corners);
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(channel.rows(), shares + cosines);
  for (Index i = 0; i < channel.rows(); ++i) {
    const Circumstances& at = channel.at(i);
    if (!std::isfinite(at.corner_mm)) continue;
    const Effect there{.range_mm = m.act(at, term.values).range_mm};
    const double size = m.formula_error * channel.response(i, there);
    columns(i, corners.at({at.target, at.along_mm > 0})) = size;
    for (int k = 1; k <= cosines; ++k)
      columns(i, shares + k - 1) = size / (k * k) * std::cos(k * pi * (x[i] + 1) / 2);
  }
  return columns;
}

/// Whatever repeats after a whole number of scans: the harmonics of its wave, as far as scans show them.
/// Those above half the number are the wave itself once more, or a lower harmonic.
Eigen::MatrixXd harmonics(const Rows& channel, const Term& term, std::size_t count) {
  constexpr int most = 4;
  const int last = std::min(most, static_cast<int>(std::round(term.values[count])) / 2);
  const std::vector<double> ahead = quarter_ahead(term);
  Eigen::MatrixXd columns(channel.rows(), 2 * std::max(0, last - 1));
  for (Index i = 0; i < channel.rows(); ++i)
    for (int k = 2; k <= last; ++k) {
      Circumstances at = channel.at(i);
      at.seq *= k;
      columns(i, 2 * k - 4) = channel.response(i, term.kind->mechanism->act(at, term.values));
      columns(i, 2 * k - 3) = channel.response(i, term.kind->mechanism->act(at, ahead));
    }
  return columns;
}

/// What a row's distance from a threshold does, were it wrong in proportion: the response's derivative by the
/// logarithm of that distance.
double by_distance(const Rows& channel, Index row, const Term& term, std::size_t threshold) {
  constexpr double by = 0.01;
  Circumstances above = channel.at(row), below = above;
  const double distance = above.intensity - term.values[threshold];
  above.intensity += by * distance;
  below.intensity -= by * distance;
  const Mechanism& m = *term.kind->mechanism;
  return (channel.response(row, m.act(above, term.values)) -
          channel.response(row, m.act(below, term.values))) /
         (2 * by);
}

/// What is drawn once for a scan scatters by chance in so few scans, and for all their beams alike: a
/// variance of n draws is known to sqrt(2 / (n - 1)) of itself.
Eigen::MatrixXd of_draws(const Rows& channel, const Term& term) {
  constexpr std::size_t most = 100;  // of more groups, neighbours count as one
  std::size_t groups = 0;
  for (Index i = 0; i < channel.rows(); ++i) groups = std::max(groups, channel.draws(i).group + 1);
  const std::size_t together = (groups + most - 1) / most;
  Eigen::MatrixXd columns(channel.rows(), 0);
  for (Index i = 0; i < channel.rows(); ++i) {
    const auto [group, scans] = channel.draws(i);
    if (scans < 2) continue;
    const Effect e = term.kind->mechanism->act(channel.at(i), term.values);
    const double size = channel.response(i, {.scan_angle_variance_rad2 = e.scan_angle_variance_rad2,
                                             .scan_range_variance_mm2 = e.scan_range_variance_mm2});
    if (!(size > 0)) continue;
    if (columns.cols() == 0)
      columns.setZero(channel.rows(), static_cast<Index>((groups + together - 1) / together));
    columns(i, static_cast<Index>(group / together)) =
        size * std::sqrt(2 / (static_cast<double>(together) * scans - 1));
  }
  return columns;
}

/// Of what is local, whose middle is the parameter before its width: a smooth function of how far away it is,
/// which ends within three of its widths. A share of the most that is there, as far away more may be left
/// than the formula says.
Eigen::MatrixXd of_local(const Rows& channel, const Term& term, std::size_t width) {
  constexpr int cosines = numbers::smooth_deviations;
  constexpr double reach = 3;
  const Mechanism& m = *term.kind->mechanism;
  const std::vector<double Effect::*>& ways = term.kind->ways;
  const double middle = term.values[width - 1], end = reach * term.values[width];
  std::vector<Effect> most(ways.size());
  for (Index i = 0; i < channel.rows(); ++i) {
    const Effect e = m.act(channel.at(i), term.values);
    for (std::size_t w = 0; w < ways.size(); ++w)
      most[w].*ways[w] = std::max(most[w].*ways[w], std::abs(e.*ways[w]));
  }
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(channel.rows(), std::ssize(ways) * cosines);
  for (Index i = 0; i < channel.rows(); ++i) {
    const Circumstances& at = channel.at(i);
    const double x = (m.away ? m.away(at, term.values) : coordinate_of(m.coordinate, at) - middle) / end;
    if (!(std::abs(x) < 1)) continue;
    const double share = m.formula_error * std::pow(std::cos(pi / 2 * x), 2);
    for (std::size_t w = 0; w < ways.size(); ++w) {
      const double size = share * channel.response(i, most[w]);
      for (int k = 0; k < cosines; ++k)
        columns(i, static_cast<Index>(w) * cosines + k) =
            size * (k == 0 ? 0.5 : std::cos(k * pi * (x + 1) / 2) / (k * k));
    }
  }
  return columns;
}

/// The formula's own deviations.
Eigen::MatrixXd of_formula(const Rows& channel, const Term& term) {
  const Kind& kind = *term.kind;
  const Mechanism& m = *kind.mechanism;
  const bool any_curve = m.any_curve || (kind.size && m.parameters[*kind.size].any_curve);
  const bool has_no_curve = (m.formula_error <= 0 && !any_curve) || m.one_target || kind.is_form() ||
                            m.coordinate == Coordinate::stage_rate ||
                            (m.parameters.size() == 1 && m.coordinate == Coordinate::target);
  if (const auto count = m.parameter_of(Parameter::Scale::count)) return harmonics(channel, term, *count);
  if (has_no_curve) return Eigen::MatrixXd(channel.rows(), 0);
  if (const auto width = m.parameter_of(Parameter::Scale::width)) return of_local(channel, term, *width);
  if (m.geometric && (m.coordinate == Coordinate::target || m.coordinate == Coordinate::edge_distance))
    return of_corners(channel, term);
  const Eigen::VectorXd x = scaled(channel, m.coordinate);
  const double share = any_curve ? numbers::free_curve_share : m.formula_error;
  if (std::ranges::any_of(kind.coefficients, &Coefficient::has_phase))
    return of_wave(channel, term, x, share);
  const std::optional<std::size_t> threshold = m.parameter_of(Parameter::Scale::threshold);
  const Effect typical = threshold ? Effect{} : typical_of(channel, term);
  // Each way to act has a formula of its own; a distance from a threshold is one.
  std::vector<Effect> wrong(threshold ? 1 : kind.ways.size());
  for (std::size_t w = 0; !threshold && w < wrong.size(); ++w) wrong[w].*kind.ways[w] = typical.*kind.ways[w];
  const int cosines = (any_curve ? 2 : 1) * numbers::smooth_deviations;
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(channel.rows(), static_cast<Index>(wrong.size()) * cosines);
  for (Index i = 0; i < channel.rows(); ++i) {
    if (kind.target >= 0 && channel.at(i).target != kind.target) continue;
    const double first = std::cos(pi * (x[i] + 1) / 2);  // the others by Chebyshev's recurrence
    for (std::size_t w = 0; w < wrong.size(); ++w) {
      const double size =
          threshold ? by_distance(channel, i, term, *threshold) : channel.response(i, wrong[w]);
      if (size == 0) continue;
      const auto at = static_cast<Index>(w) * cosines;
      columns(i, at) = size * (any_curve ? 1 : share / 2);
      double before = 1, now = first;
      for (int k = 1; k < cosines; ++k) {
        columns(i, at + k) = size * share / (k * k) * now;
        before = std::exchange(now, 2 * first * now - before);
      }
    }
  }
  return columns;
}

}  // namespace

Deviations deviations_of(const Rows& channel, const Term& term) {
  Deviations d;
  if (term.kind->mechanism->coordinate == Coordinate::approach) {
    d.columns = place_in_play(channel, term);
  } else {
    d.columns = of_formula(channel, term);
    d.of_formula = d.columns.cols();
    d.columns = with_zero_elsewhere(channel, term, std::move(d.columns));
    if (term.kind->mechanism->coordinate == Coordinate::temperature)
      d.columns = of_unread(channel, term, std::move(d.columns));
  }
  const Eigen::MatrixXd draws = of_draws(channel, term);
  if (draws.cols() == 0) return d;
  d.columns.conservativeResize(Eigen::NoChange, d.columns.cols() + draws.cols());
  d.columns.rightCols(draws.cols()) = draws;
  return d;
}

}  // namespace fit::explain::model
