// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "fit/numeric/angle.hpp"

namespace fit::explain::forms {

/// Cosines that make a curve over -1 .. 1 with the spectrum of a Gaussian process that has a derivative, and
/// may kink (Matern, of order 3/2); `length`: its correlation length as a share of the span.
inline int cosines_of(double length) { return std::clamp(static_cast<int>(3 / length), 4, 30); }

/// Cosines have no slope at their ends: these end beyond the curve's.
inline constexpr double beyond_ends = 1.2;
inline double cosine(double x, int number) { return std::cos((number + 1) * pi * (x / beyond_ends + 1) / 2); }

/// Standard sizes of their coefficients where the curve has that of 1.
inline std::vector<double> shares_of_cosines(double length) {
  std::vector<double> list;
  double squares = 0;
  for (int j = 1; j <= cosines_of(length); ++j) {
    list.push_back(1 / (1 + std::pow(j * pi * length / beyond_ends, 2) / 3));
    squares += list.back() * list.back();
  }
  for (double& share : list) share *= std::sqrt(2 / squares);
  return list;
}

}  // namespace fit::explain::forms
