// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/model/extent.hpp"
#include "fit/explain/model/term.hpp"

namespace fit::explain::answer {
namespace {

constexpr int bins = 30;

/// Equal parts of a coordinate, and which of them every mean is in; -1: none.
struct Bins {
  /// `target`: of the places along that one.
  Bins(const MeanModel& model, Coordinate along, int target = -1) : coordinate(along) {
    std::vector<double> at;
    for (Eigen::Index i = 0; i < model.rows(); ++i)
      all.add(at.emplace_back(coordinate_at(model, coordinate, i, target)));
    for (const double v : at) of_row.push_back(std::isfinite(v) ? bin(v) : -1);
  }
  [[nodiscard]] bool varies() const { return all.high > all.low; }
  [[nodiscard]] double width() const { return all.length() / bins; }
  [[nodiscard]] int bin(double v) const {
    return std::clamp(static_cast<int>((v - all.low) / std::max(1e-12, width())), 0, bins - 1);
  }
  /// Of something over the means in every bin.
  template <class Of>
  [[nodiscard]] std::vector<double> sums(const Of& of) const {
    std::vector<double> list(bins, 0.0);
    for (std::size_t i = 0; i < of_row.size(); ++i)
      if (of_row[i] >= 0) list[static_cast<std::size_t>(of_row[i])] += of(static_cast<Eigen::Index>(i));
    return list;
  }
  /// Of a value for every bin, those in the interval.
  [[nodiscard]] std::span<const double> in(const Located& l, const std::vector<double>& values) const {
    const int first = bin(l.from + 1e-9), last = bin(l.to - 1e-9);
    return std::span(values).subspan(static_cast<std::size_t>(first),
                                     static_cast<std::size_t>(std::max(0, last + 1 - first)));
  }

  Coordinate coordinate;
  Extent all;
  std::vector<int> of_row;
};

/// Neighbouring marked bins form one interval; a gap of one bin is bridged.
std::vector<Located> intervals(const Bins& parts, const std::vector<bool>& marked) {
  std::vector<Located> list;
  int last = -10;
  for (int b = 0; b < bins; ++b) {
    if (!marked[static_cast<std::size_t>(b)]) continue;
    const double from = parts.all.low + b * parts.width();
    if (b - last <= 2 && !list.empty())
      list.back().to = from + parts.width();
    else
      list.push_back({parts.coordinate, from, from + parts.width(), Observable::range_mean, 1});
    last = b;
  }
  return list;
}

double two_sided(double z) { return std::max(1e-300, std::erfc(std::abs(z) / std::sqrt(2.0))); }

/// Sums over bins, by the means' weights.
std::vector<double> weighted(const Bins& parts, const MeanModel& model, const Eigen::VectorXd& of) {
  return parts.sums(
      [&](Eigen::Index i) { return 1 / (model.sigma_of_mean(i) * model.sigma_of_mean(i)) * of[i]; });
}

/// Where an effect shows, by its information in bins of its coordinate.
std::vector<Located> locate_effect(const MeanModel& model, const Eigen::VectorXd& effect_mm,
                                   Coordinate coordinate) {
  const Bins parts(model, coordinate);
  const Eigen::VectorXd left = model.remainder(effect_mm);
  const std::vector<double> information =
      parts.sums([&](Eigen::Index i) { return std::pow(left[i] / model.sigma_of_mean(i), 2); });
  const double most = std::ranges::max(information);
  std::vector<bool> marked;
  for (const double one : information) marked.push_back(most > 0 && one >= most / 4);
  auto list = intervals(parts, marked);
  for (Located& l : list) {
    double sum = 0;
    for (const double one : parts.in(l, information)) sum += one;
    l.p_value = two_sided(std::sqrt(sum));
  }
  return list;
}

/// Where residuals are significant, with a controlled false-discovery rate.
std::vector<Located> locate_residuals(const MeanModel& model, double false_discoveries) {
  const Eigen::VectorXd residual = model.residual(), ones = Eigen::VectorXd::Ones(model.rows());
  std::vector<std::pair<Bins, std::vector<double>>> tested;  // with p of every bin; 1: no means
  std::vector<double> sorted;
  for (const Coordinate coordinate :
       {Coordinate::beam, Coordinate::stage, Coordinate::range, Coordinate::intensity, Coordinate::incidence,
        Coordinate::time, Coordinate::temperature, Coordinate::stage_rate}) {
    Bins parts(model, coordinate);
    if (!parts.varies()) continue;
    const std::vector<double> sum = weighted(parts, model, residual), weight = weighted(parts, model, ones);
    std::vector<double> p(bins, 1.0);
    for (std::size_t b = 0; b < bins; ++b)
      if (weight[b] > 0) sorted.push_back(p[b] = two_sided(sum[b] / std::sqrt(weight[b])));
    tested.emplace_back(std::move(parts), std::move(p));
  }
  // Benjamini and Hochberg (1995): the largest p below its line, and all smaller ones.
  std::ranges::sort(sorted);
  double threshold = 0;
  for (std::size_t i = 0; i < sorted.size(); ++i)
    if (sorted[i] <= false_discoveries * static_cast<double>(i + 1) / static_cast<double>(sorted.size()))
      threshold = sorted[i];
  std::vector<Located> list;
  for (const auto& [parts, p] : tested) {
    std::vector<bool> marked;
    for (const double one : p) marked.push_back(one <= threshold);
    for (Located l : intervals(parts, marked)) {
      for (const double one : parts.in(l, p)) l.p_value = std::min(l.p_value, one);
      list.push_back(l);
    }
  }
  return list;
}

/// Of the residual means.
Curve curve_of(const MeanModel& before, const MeanModel& after, Coordinate coordinate, int target) {
  Curve curve;
  curve.coordinate = coordinate;
  if (target >= 0) curve.target = before.bench().target_at(target).name;
  Bins parts(before, coordinate, target);
  if (!parts.varies()) return curve;
  parts.of_row.resize(static_cast<std::size_t>(std::min(before.rows(), after.rows())));
  const std::vector<double> sum = weighted(parts, before, before.residual()),
                            less = weighted(parts, before, after.residual()),
                            weight = weighted(parts, before, Eigen::VectorXd::Ones(before.rows()));
  for (std::size_t b = 0; b < bins; ++b) {
    if (weight[b] <= 0) continue;
    curve.at.push_back(parts.all.low + (static_cast<double>(b) + 0.5) * parts.width());
    curve.before_mm.push_back(sum[b] / weight[b]);
    curve.after_mm.push_back(less[b] / weight[b]);
    curve.sigma_mm.push_back(1 / std::sqrt(weight[b]));
  }
  return curve;
}

double p_value(double evidence) { return std::exp(-std::clamp(evidence, 0.0, 600.0)); }

/// What was recorded of a coordinate, if anything.
std::optional<Recorded> recorded(const Reduced& reduced, Coordinate coordinate) {
  Extent all;
  for (const Cell& cell : reduced.cells) all.add(model::coordinate_of(coordinate, cell.at));
  if (coordinate == Coordinate::scan_seq)
    for (const Sector& s : reduced.sectors) all.add(s.seq);
  if (!(all.high >= all.low)) return {};
  return Recorded{all.low, all.high, reduced.bench.lidar.scan_hz};
}

std::vector<Located> located(const Suspect& suspect, const Reduced& reduced) {
  const Mechanism& m = *suspect.mechanism;
  const auto there = recorded(reduced, m.coordinate);
  if (!there) return {};
  Finding finding;
  finding.parameters = suspect.parameters;
  const std::vector<Interval> intervals =
      m.shows ? m.shows(finding, *there) : std::vector<Interval>{{m.coordinate, there->from, there->to}};
  std::vector<Located> list;
  for (const Interval& s : intervals)
    list.push_back({s.coordinate, s.from, s.to, m.observable, p_value(suspect.gain)});
  return list;
}

/// Where it acts, or if it does not say so, wherever there is a recording.
Located located(const Unexplained& u, const Reduced& reduced) {
  Located l{u.coordinate, u.from, u.to, u.observable, p_value(u.gain)};
  if (const auto there = recorded(reduced, u.coordinate);
      there && u.from == u.to && u.coordinate != Coordinate::target) {
    l.from = there->from;
    l.to = there->to;
  }
  return l;
}

/// `before`: the means before anything was explained.
void locate(const MeanModel& before, const Reduced& reduced, const Inferred& inferred,
            std::vector<Located>& out, bool reports_unknown) {
  const Hypothesis& best = inferred.means.best;
  const auto add = [&](const std::vector<Located>& list) {
    std::ranges::copy(list, std::back_inserter(out));
  };
  std::set<Coordinate> taken;
  for (const Active& term : best.terms)
    if (taken.insert(term.mechanism->coordinate).second)
      add(locate_effect(before, effect_of(before, term), term.mechanism->coordinate));
  for (const Shape& shape : best.shapes)
    if (taken.insert(shape.coordinate).second)
      add(locate_effect(before, effect_of(before, shape), shape.coordinate));
  for (const Suspect& suspect : inferred.accepted) add(located(suspect, reduced));
  if (reports_unknown && best.shapes.empty())
    for (const Unexplained& u : inferred.unknown) out.push_back(located(u, reduced));
  if (!best.terms.empty() || !best.shapes.empty())
    for (const Located& l : locate_residuals(before, 0.01))
      if (!taken.contains(l.coordinate)) out.push_back(l);
  for (Located& l : out) {
    if (l.coordinate != Coordinate::temperature) continue;
    l.from += reduced.reference_temperature_c;
    l.to += reduced.reference_temperature_c;
  }
}

/// A curve for every coordinate of what was found, and for beam, range and time.
std::vector<Curve> curves(const MeanModel& before, const MeanModel& after, const Hypothesis& best) {
  std::vector<std::pair<Coordinate, int>> wanted;  // and the target along which
  for (const Active& term : best.terms) wanted.emplace_back(term.mechanism->coordinate, -1);
  for (const Shape& shape : best.shapes)
    wanted.emplace_back(shape.coordinate, shape.is_along_one_target() ? shape.target : -1);
  for (const Coordinate c : {Coordinate::beam, Coordinate::range, Coordinate::time})
    wanted.emplace_back(c, -1);
  std::set<std::pair<Coordinate, int>> drawn;
  std::vector<Curve> list;
  for (const auto& [coordinate, target] : wanted) {
    if (!drawn.insert({coordinate, target}).second) continue;
    Curve curve = curve_of(before, after, coordinate, target);
    if (curve.at.size() > 1) list.push_back(std::move(curve));
  }
  return list;
}

}  // namespace

void report_where(const Reduced& reduced, const Inferred& inferred, Explanation& out) {
  const MeanResult& means = inferred.means;
  Hypothesis nothing(reduced.bench);
  nothing.nuisance = means.best.nuisance;
  Reduced rows = merged(reduced, rows_for_tables);
  predict_at(rows, nothing);
  const MeanModel before = model_of(rows, means.noise, nothing);
  locate(before, reduced, inferred, out.located, out.unknown.has_value());
  Reduced explained = rows;
  predict_at(explained, means.best);
  const MeanModel after = model_of(explained, means.noise, means.best);
  out.curves = curves(before, after, means.best);
}

}  // namespace fit::explain::answer
