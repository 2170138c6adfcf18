// SPDX-License-Identifier: MIT
#include "fit/range/extra_scatter.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace fit {
namespace {

/// How far `at` lies off the polynomial through the others: its square over the variance that scatter of unit
/// size gives it, less what the points' own uncertainties do.
double excess_square(const CurvePoint& at, std::span<const CurvePoint> others) {
  double off = at.y, own = at.u * at.u, parts = 1;
  for (const CurvePoint& p : others) {
    double weight = 1;  // Lagrange's
    for (const CurvePoint& q : others)
      if (q.x != p.x) weight *= (at.x - q.x) / (p.x - q.x);
    off -= weight * p.y;
    own += weight * weight * p.u * p.u;
    parts += weight * weight;
  }
  return (off * off - own) / parts;
}

}  // namespace

double extra_scatter(std::span<const CurvePoint> points) {
  constexpr std::size_t fewest = 5;  // comparisons
  std::vector<CurvePoint> sorted(points.begin(), points.end());
  std::ranges::stable_sort(sorted, {}, &CurvePoint::x);
  const auto same_place = [](const CurvePoint& a, const CurvePoint& b) { return a.x == b.x; };
  sorted.erase(std::unique(sorted.begin(), sorted.end(), same_place), sorted.end());
  for (const std::size_t reach : {std::size_t{3}, std::size_t{2}, std::size_t{1}}) {
    if (sorted.size() < 2 * reach + fewest) continue;
    std::vector<double> excess;
    for (std::size_t i = reach; i + reach < sorted.size(); ++i) {
      std::vector<CurvePoint> others(sorted.begin() + static_cast<std::ptrdiff_t>(i - reach),
                                     sorted.begin() + static_cast<std::ptrdiff_t>(i + reach + 1));
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(reach));
      excess.push_back(excess_square(sorted[i], others));
    }
    return std::sqrt(std::max(
        0.0, std::accumulate(excess.begin(), excess.end(), 0.0) / static_cast<double>(excess.size())));
  }
  return 0;
}

}  // namespace fit
