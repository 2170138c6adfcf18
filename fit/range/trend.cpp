// SPDX-License-Identifier: MIT
#include "fit/range/trend.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "fit/numeric/distributions.hpp"
#include "fit/range/selection.hpp"

namespace fit {
namespace {

/// Freedom at which Student's distribution is the normal one.
constexpr double as_good_as_normal = 1e6;

/// u of the mean of what a line leaves, from the means of blocks: sees memory too weak for any single lag.
double u_by_blocks(const std::vector<double>& rest) {
  constexpr std::size_t blocks = 20;
  double squares = 0;
  for (std::size_t block = 0; block < blocks; ++block) {
    const std::size_t from = rest.size() * block / blocks, to = rest.size() * (block + 1) / blocks;
    double sum = 0;
    for (std::size_t i = from; i < to; ++i) sum += rest[i];
    squares += std::pow(sum / static_cast<double>(to - from), 2);
  }
  return std::sqrt(squares / (blocks - 2) / blocks);
}

}  // namespace

bool Trend::beyond(double chance) const {
  return is_known() && std::abs(rise.value) > student_quantile(effective - 2, 1 - chance / 2) * rise.u;
}

Trend trend_of(std::span<const double> values) {
  const auto n = static_cast<double>(values.size());
  Trend out;
  out.rise.u = std::numeric_limits<double>::infinity();
  if (values.size() < 20) return out;
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / n, middle = (n - 1) / 2;
  double product = 0;
  for (std::size_t i = 0; i < values.size(); ++i)
    product += (static_cast<double>(i) - middle) * (values[i] - mean);
  const double spread = n * (n * n - 1) / 12, slope = product / spread;
  std::vector<double> rest;
  double squares = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    rest.push_back(values[i] - mean - slope * (static_cast<double>(i) - middle));
    squares += rest.back() * rest.back();
  }
  // The line must not pass for memory, nor memory for the line. What is rounded is never known better than
  // that.
  out.sd = std::max(std::sqrt(squares / (n - 2)), 1 / std::sqrt(12.0));
  const double u_mean = std::max(out.sd * std::sqrt(correlation_time(rest) / n), u_by_blocks(rest));
  out.effective = std::min(n, out.sd * out.sd / (u_mean * u_mean));
  out.rise = {slope * (n - 1), out.sd * std::sqrt(12 / out.effective)};
  if (out.sd < 0.5)
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
    const double z = trend.rise.value / trend.rise.u;
    squares += z * z, sum += z;
    one_does = one_does || trend.beyond(each / n);
  }
  return one_does || chi_squared_cdf(n, squares) > 1 - each ||
         std::abs(sum) > student_quantile(as_good_as_normal, 1 - each / 2) * std::sqrt(n);
}

}  // namespace fit
