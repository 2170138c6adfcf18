// SPDX-License-Identifier: MIT
#include "fit/explain/intensity/bells.hpp"

#include <algorithm>
#include <cmath>

namespace fit::explain::intensity {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct Ends {
  double low = 1e300, high = -1e300;
};

Ends ends_of(const VectorXd& x) {
  Ends ends;
  for (const double v : x)
    if (std::isfinite(v)) {
      ends.low = std::min(ends.low, v);
      ends.high = std::max(ends.high, v);
    }
  return ends;
}

}  // namespace

double span_of(const VectorXd& x) {
  const auto [low, high] = ends_of(x);
  return high > low ? high - low : 0;
}

MatrixXd bells(const VectorXd& x, double length) {
  const auto [low, high] = ends_of(x);
  if (!(high > low)) return MatrixXd(x.size(), 0);
  const int knots = static_cast<int>(std::ceil((high - low) / length)) + 3;
  MatrixXd columns = MatrixXd::Zero(x.size(), knots);
  for (int k = 0; k < knots; ++k)
    for (Index i = 0; i < x.size(); ++i) {
      if (!std::isfinite(x[i])) continue;
      const double d = (x[i] - (low + (k - 1) * length)) / length;
      if (std::abs(d) < 4) columns(i, k) = 0.75 * std::exp(-d * d / 2);
    }
  return columns;
}

}  // namespace fit::explain::intensity
