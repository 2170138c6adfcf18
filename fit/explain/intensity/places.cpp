// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/places.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "fit/empirical.hpp"
#include "fit/explain/intensity/deviations.hpp"
#include "fit/explain/intensity/unnamed.hpp"
#include "fit/explain/stretches.hpp"

namespace fit::explain::intensity {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr int bins_of_places = 30, bins_of_curve = 40;
constexpr std::size_t places_of_table = 150;
constexpr double least_width = 1e-9;  // of a bin; a coordinate may have one value only

/// A coordinate cut into bins of one width.
template <int count>
struct Bins {
  double low, width;
  explicit Bins(const VectorXd& x)
      : low(x.minCoeff()), width(std::max(least_width, (x.maxCoeff() - low) / count)) {}
  [[nodiscard]] std::size_t of(double value) const {
    return static_cast<std::size_t>(std::clamp(static_cast<int>((value - low) / width), 0, count - 1));
  }
};

/// What something accepted does, row by row, whatever its kind.
VectorXd whole_effect(const Readings& readings, const std::vector<Suspicion>& accepted, const Suspicion& s,
                      const IntensityLaw& law) {
  if (!s.mechanism) return function_of(readings, accepted, s);
  if (s.acts()) return effect_of(readings, s);
  VectorXd effect(readings.count());
  for (Index i = 0; i < readings.count(); ++i)
    effect[i] = readings.predicted(i, law) - readings.predicted(i, readings.claim.law);
  return effect;
}

/// Means of both over stretches of the first; never two places for one value of it.
void tabulate(std::vector<std::pair<double, double>> places, EmpiricalFunction& table) {
  std::ranges::sort(places);
  const std::size_t each = 1 + places.size() / places_of_table;
  const auto place_of = [&](std::size_t k) { return places[k].first; };
  for (const auto& [from, to] : stretches(places.size(), each, place_of)) {
    double sum_x = 0, sum_y = 0;
    for (std::size_t k = from; k < to; ++k) {
      sum_x += places[k].first;
      sum_y += places[k].second;
    }
    table.at.push_back(sum_x / static_cast<double>(to - from));
    table.value.push_back(sum_y / static_cast<double>(to - from));
  }
}

EmpiricalFunction table_of(const Readings& readings, const std::vector<Suspicion>& accepted,
                           const Suspicion& s) {
  EmpiricalFunction table{s.about >= 0 ? "along_mm" : name_of(s.along()), "log_intensity", "", {}, {}};
  const int target = s.mechanism ? s.target : s.about;
  if (target >= 0) table.target = readings.target(target).name;
  const VectorXd x = s.mechanism ? readings.coordinate(s.mechanism->coordinate) : places_of(readings, s);
  const VectorXd y = s.mechanism ? effect_of(readings, s) : function_of(readings, accepted, s);
  std::vector<std::pair<double, double>> places;
  for (Index i = 0; i < readings.count(); ++i)
    if (std::isfinite(x[i]) && (target < 0 || readings.cell(i).at.target == target))
      places.emplace_back(x[i], y[i]);
  tabulate(std::move(places), table);
  return table;
}

}  // namespace

std::vector<Located> locate(const Readings& readings, const std::vector<Suspicion>& accepted,
                            const Suspicion& s, const IntensityLaw& law) {
  const VectorXd x = readings.coordinate(s.along());
  const VectorXd effect = whole_effect(readings, accepted, s, law);
  const Bins<bins_of_places> bins(x);
  std::array<double, bins_of_places> information{};
  for (Index i = 0; i < readings.count(); ++i)
    information[bins.of(x[i])] += std::pow(effect[i] / readings.row(i).sigma, 2);
  const double most = *std::ranges::max_element(information);
  std::vector<Located> list;
  int last = -10;
  for (int b = 0; b < bins_of_places; ++b) {
    const double own = information[static_cast<std::size_t>(b)];
    if (own < 0.25 * most || most <= 0) continue;
    const double p = std::max(1e-300, std::erfc(std::sqrt(own / 2)));
    const double from = bins.low + b * bins.width, to = bins.low + (b + 1) * bins.width;
    if (b - last <= 2 && !list.empty()) {  // a gap of one bin is bridged
      list.back().to = to;
      list.back().p_value = std::min(list.back().p_value, p);
    } else {
      list.push_back({s.along(), from, to, Observable::intensity, p});
    }
    last = b;
  }
  return list;
}

std::vector<IntensityCurve> curves_of(const Readings& readings, const Model& after) {
  const VectorXd first = model_of(readings, {}).residual(), last = after.residual();
  std::vector<IntensityCurve> curves;
  for (const Coordinate c : {Coordinate::beam, Coordinate::range, Coordinate::incidence}) {
    const VectorXd x = readings.coordinate(c);
    const Bins<bins_of_curve> bins(x);
    if (!(bins.width > least_width)) continue;
    IntensityCurve curve;
    curve.coordinate = c;
    std::array<double, bins_of_curve> weight{}, before_sum{}, after_sum{};
    for (Index i = 0; i < readings.count(); ++i) {
      const std::size_t b = bins.of(x[i]);
      const double w = 1 / std::pow(readings.row(i).sigma, 2);
      weight[b] += w;
      before_sum[b] += w * first[i];
      after_sum[b] += w * last[i];
    }
    for (std::size_t b = 0; b < weight.size(); ++b) {
      if (weight[b] <= 0) continue;
      curve.at.push_back(bins.low + (static_cast<double>(b) + 0.5) * bins.width);
      curve.before.push_back(before_sum[b] / weight[b]);
      curve.after.push_back(after_sum[b] / weight[b]);
      curve.sigma.push_back(1 / std::sqrt(weight[b]));
    }
    curves.push_back(std::move(curve));
  }
  return curves;
}

void add_tables(const Readings& readings, const Judgement& judgement, Bench& bench) {
  for (const Judged& j : judgement.judged) {
    const Suspicion& s = j.suspicion;
    if (!s.coefficients.empty()) continue;      // the bench's law is stated anew
    if (s.mechanism && j.is_found()) continue;  // known to the bench from now on
    const EmpiricalFunction table = table_of(readings, judgement.accepted, s);
    if (table.at.size() > 1) add_empirical(bench, table);
  }
}

}  // namespace fit::explain::intensity
