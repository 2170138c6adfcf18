// SPDX-License-Identifier: MIT
#pragma once

#include <span>

#include "fit/numeric/estimate.hpp"

namespace fit {

/// A straight line through values in the order in which they were taken, by least squares.
struct Trend {
  Estimate rise;         ///< From the first to the last, in the values' unit. u: with their autocorrelation.
  double effective = 0;  ///< Independent values that they are worth about the line.
  double freedom = 1;    ///< Degrees of freedom of the rise's u.
  /// Fewer say too little of their autocorrelation.
  [[nodiscard]] bool is_known() const { return effective >= 50; }
  /// The rise as a deviate of the standard normal distribution, were the values steady.
  [[nodiscard]] double deviate() const;
  /// Whether steady values show such a rise, of either sign, at most with probability `chance`.
  [[nodiscard]] bool beyond(double chance) const;
};

/// Autocorrelation over more than about a tenth of the series is no different from a trend.
[[nodiscard]] Trend trend_of(std::span<const double> values);

/// Whether steady series show such trends at most with probability `chance`, all together. Three tests share
/// it: the largest of them (Bonferroni), their squares (chi-squared), and their sum, as what warms up moves
/// one way.
[[nodiscard]] bool drift_together(std::span<const Trend> trends, double chance);

}  // namespace fit
