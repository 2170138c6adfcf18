// SPDX-License-Identifier: MIT
#include "rig/archive/control_chart.hpp"

#include <algorithm>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>

#include "fit/numeric/number_format.hpp"
#include "rig/archive/middle.hpp"

namespace rig {
namespace {

using Points = std::set<std::size_t>;

/// Points of windows of `of` successive ones, of which at least `least` lie beyond `limit` on one side.
Points beyond(std::span<const double> z, double limit, std::size_t least, std::size_t of) {
  Points all;
  for (const double side : {1.0, -1.0})
    for (std::size_t last = 0; last < z.size(); ++last) {
      Points points;
      for (std::size_t i = last + 1 >= of ? last + 1 - of : 0; i <= last; ++i)
        if (side * z[i] > limit) points.insert(i);
      if (points.size() >= least) all.merge(points);
    }
  return all;
}

/// Points of rising or falling runs of at least that length.
Points in_runs(std::span<const double> z, std::size_t length) {
  Points all;
  for (const double side : {1.0, -1.0})
    for (std::size_t from = 0, i = 1; i <= z.size(); ++i) {
      if (i < z.size() && side * z[i] > side * z[i - 1]) continue;
      for (std::size_t k = from; i - from >= length && k < i; ++k) all.insert(k);
      from = i;
    }
  return all;
}

bool far_more(double variance, double nu, double expected, double nu_expected) {
  constexpr double hardly_by_chance = 0.01;
  const boost::math::fisher_f ratio(nu, nu_expected);
  return boost::math::cdf(boost::math::complement(ratio, variance / expected)) < hardly_by_chance;
}

}  // namespace

std::vector<ChartSignal> chart_signals(std::span<const double> z) {
  std::vector<ChartSignal> out;
  const auto add = [&](const char* rule, const Points& points) {
    if (!points.empty()) out.push_back({rule, {points.begin(), points.end()}});
  };
  add("Western Electric 1: a value beyond three standard deviations", beyond(z, 3, 1, 1));
  add("Western Electric 2: two of three beyond two standard deviations on one side", beyond(z, 2, 2, 3));
  add("Western Electric 3: four of five beyond one standard deviation on one side", beyond(z, 1, 4, 5));
  add("Western Electric 4: eight in a row on one side of the centre line", beyond(z, 0, 8, 8));
  add("Nelson 3: six in a row rising or falling", in_runs(z, 6));
  return out;
}

Repeatability repeatability_of(std::vector<double> differences) {
  constexpr double median_of_half_normal =
      0.953873;  // Of the difference of two values of unit standard deviation.
  Repeatability out;
  out.differences = differences.size();
  if (differences.empty()) return out;
  for (double& d : differences) d = std::abs(d);
  out.sigma = middle_of(std::move(differences)) / median_of_half_normal;
  return out;
}

double e_n(double value, double expanded, double before, double expanded_before) {
  const double both = std::hypot(expanded, expanded_before);
  return both > 0 ? (value - before) / both : std::nan("");
}

Drift drift_of(std::span<const double> years, std::span<const double> values, double sigma,
               double degrees_of_freedom) {
  Drift out;
  const auto n = static_cast<double>(values.size());
  if (values.size() < 3 || years.size() != values.size()) return out;
  const double t_mean = std::accumulate(years.begin(), years.end(), 0.0) / n;
  const double y_mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double tt = 0, ty = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    tt += (years[i] - t_mean) * (years[i] - t_mean);
    ty += (years[i] - t_mean) * (values[i] - y_mean);
  }
  constexpr double shortest_years = 1e-4;  // An hour: sessions of one day are no history.
  if (tt < shortest_years * shortest_years) return out;
  out.per_year = ty / tt;
  out.at_zero = y_mean - out.per_year * t_mean;
  double squares = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double r = values[i] - out.at_zero - out.per_year * years[i];
    squares += r * r;
  }
  const double left = n - 2;
  out.residual = std::sqrt(squares / left);
  // Both tell how much a value scatters, unless the values about the line scatter far more than the archive
  // says.
  double variance = squares / left, nu = left;
  if (sigma > 0 && degrees_of_freedom > 0 && !far_more(variance, left, sigma * sigma, degrees_of_freedom)) {
    variance = (squares + degrees_of_freedom * sigma * sigma) / (left + degrees_of_freedom);
    nu = left + degrees_of_freedom;
  }
  out.u = std::sqrt(variance / tt);
  out.degrees_of_freedom = nu;
  out.expanded = fit::coverage_factor(out.degrees_of_freedom) * out.u;
  const boost::math::students_t student(out.degrees_of_freedom);
  out.p_value = out.u > 0
                    ? 2 * boost::math::cdf(boost::math::complement(student, std::abs(out.per_year) / out.u))
                    : (out.per_year == 0 ? 1 : 0);
  return out;
}

double years_until(double up, double down, double per_year, double expanded) {
  const auto reach = [](double room, double rate) {
    return room <= 0 ? 0.0 : rate > 0 ? room / rate : INFINITY;
  };
  return std::min(reach(up, per_year + expanded), reach(down, -per_year + expanded));
}

std::vector<bool> found_at_rate(std::span<const double> p, double rate) {
  std::vector<double> sorted(p.begin(), p.end());
  std::ranges::sort(sorted);
  double limit = -1;
  for (std::size_t i = 0; i < sorted.size(); ++i)
    if (sorted[i] <= rate * static_cast<double>(i + 1) / static_cast<double>(sorted.size()))
      limit = sorted[i];
  std::vector<bool> found;
  for (const double each : p) found.push_back(each <= limit);
  return found;
}

}  // namespace rig
