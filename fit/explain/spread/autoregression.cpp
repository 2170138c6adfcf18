// SPDX-License-Identifier: MIT
#include "fit/explain/spread/autoregression.hpp"

#include <cmath>
#include <cstdlib>
#include <vector>

namespace fit::explain::spread {

std::array<double, 4> lagged_of(int n, double rho) {
  std::array<double, 4> sums{};
  std::vector<double> row(static_cast<std::size_t>(n));
  double mean = 0;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) row[static_cast<std::size_t>(i)] += std::pow(rho, std::abs(i - j)) / n;
    mean += row[static_cast<std::size_t>(i)] / n;
  }
  for (int lag = 0; lag <= 3; ++lag)
    for (int i = 0; i + lag < n; ++i)
      sums[static_cast<std::size_t>(lag)] += (lag == 0 ? 1 : std::pow(rho, lag)) -
                                             row[static_cast<std::size_t>(i)] -
                                             row[static_cast<std::size_t>(i + lag)] + mean;
  return sums;
}

double pairs_at(int lag, int n, double rho) {
  return 2 * (1 - static_cast<double>(lag) / n) * std::pow(rho, lag);
}

}  // namespace fit::explain::spread
