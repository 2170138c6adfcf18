// SPDX-License-Identifier: MIT
#include "fit/range/trend.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "fit/numeric/distributions.hpp"
#include "fit/numeric/straight_line.hpp"

namespace fit {
namespace {

/// Curves of degree 2 to 7: memory shorter than about a tenth of the series acts on each of them as on the
/// line, so that the rise has Student's distribution.
constexpr int curves = 6;

/// u of the mean of what a line leaves, from the orthogonal polynomials above the line (Gram's).
double u_by_curves(const std::vector<double>& rest) {
  const double middle = (static_cast<double>(rest.size()) - 1) / 2;
  std::vector<double> now(rest.size(), 1), before(rest.size(), 0);
  double norm = static_cast<double>(rest.size()), norm_before = 0, squares = 0;
  for (int degree = 1; degree <= curves + 1; ++degree) {
    const double share = norm_before > 0 ? norm / norm_before : 0;
    double next_norm = 0, product = 0;
    for (std::size_t i = 0; i < rest.size(); ++i) {
      const double next = (static_cast<double>(i) / middle - 1) * now[i] - share * before[i];
      before[i] = now[i], now[i] = next;
      next_norm += next * next, product += next * rest[i];
    }
    if (degree > 1) squares += product * product / next_norm;
    norm_before = norm, norm = next_norm;
  }
  return std::sqrt(squares / curves / static_cast<double>(rest.size()));
}

}  // namespace

double Trend::deviate() const { return normal_equivalent(freedom, rise.value / rise.u); }

bool Trend::beyond(double chance) const {
  return is_known() && std::abs(deviate()) > normal_quantile(1 - chance / 2);
}

Trend trend_of(std::span<const double> values) {
  const auto n = static_cast<double>(values.size());
  Trend out;
  out.rise.u = std::numeric_limits<double>::infinity();
  if (values.size() < 20) return out;
  StraightLine line;
  for (std::size_t i = 0; i < values.size(); ++i) line.add(static_cast<double>(i), values[i]);
  std::vector<double> rest;
  for (std::size_t i = 0; i < values.size(); ++i) rest.push_back(values[i] - line.at(static_cast<double>(i)));
  // The line must not pass for memory, nor memory for the line. What is rounded is never known better than
  // that.
  const double sd = std::max(std::sqrt(std::max(0.0, line.off()) / (n - 2)), 1 / std::sqrt(12.0));
  const double u_mean = u_by_curves(rest);
  out.effective = std::min(n, sd * sd / (u_mean * u_mean));
  out.freedom = curves;
  out.rise = {line.slope() * (n - 1), sd * std::sqrt(12 / out.effective)};
  if (sd < 0.5)
    out.rise.u = std::hypot(out.rise.u, 1 / std::sqrt(6.0));  // Two roundings that do not average out.
  return out;
}

bool drift_together(std::span<const Trend> trends, double chance) {
  const auto known = std::ranges::count_if(trends, &Trend::is_known);
  if (known == 0) return false;
  const double each = chance / 3, n = static_cast<double>(known);
  double squares = 0, sum = 0;
  bool one_does = false;
  for (const Trend& trend : trends) {
    if (!trend.is_known()) continue;
    const double z = trend.deviate();
    squares += z * z, sum += z;
    one_does = one_does || trend.beyond(each / n);
  }
  return one_does || chi_squared_cdf(n, squares) > 1 - each ||
         std::abs(sum) > normal_quantile(1 - each / 2) * std::sqrt(n);
}

}  // namespace fit
