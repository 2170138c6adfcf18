// SPDX-License-Identifier: MIT
#include "fit/explain/model/autoregression.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace fit::explain::model {

LagSums lagged_of(int n, double rho) {
  // Correlation of every value with the mean of all, and what of it the values up to there have together.
  std::vector<double> up_to{0.0};
  const auto geometric = [rho](int terms) { return rho * (1 - std::pow(rho, terms)) / (1 - rho); };
  for (int i = 0; i < n; ++i) up_to.push_back(up_to.back() + (1 + geometric(i) + geometric(n - 1 - i)) / n);
  const auto to = [&](int i) { return up_to[static_cast<std::size_t>(i)]; };
  const double of_mean = to(n) / n;
  return sums_over_bands(n, [&](int lag) {
    return (n - lag) * ((lag == 0 ? 1 : std::pow(rho, lag)) + of_mean) - to(n - lag) - (to(n) - to(lag));
  });
}

LagSums pairs_of(int n) {
  return sums_over_bands(n, [n](int lag) { return n - lag; });
}

double added_to_mean(int n, double rho) {
  double sum = 0;
  for (int lag = 1; lag < n; ++lag) sum += 2 * (1 - static_cast<double>(lag) / n) * std::pow(rho, lag);
  return sum;
}

}  // namespace fit::explain::model
