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

LagCovariance covariance_of_lagged(int n, double rho, double share) {
  const int longest = std::min(lag_bands.back().last, n - 1);
  std::vector<double> correlation(static_cast<std::size_t>(2 * (n + longest) + 1));
  for (std::size_t lag = 0; lag < correlation.size(); ++lag)
    correlation[lag] = lag == 0 ? 1 : share * std::pow(rho, static_cast<double>(lag));
  const auto at = [&](int lag) { return correlation[static_cast<std::size_t>(std::abs(lag))]; };
  const auto band_of = [](int lag) {
    Eigen::Index band = 0;
    while (lag > lag_bands[static_cast<std::size_t>(band)].last) ++band;
    return band;
  };
  LagCovariance sum = LagCovariance::Zero();
  for (int j = 0; j <= longest; ++j)
    for (int k = j; k <= longest; ++k) {
      double both = 0;
      for (int m = -n; m <= n; ++m) both += at(m) * at(m + k - j) + at(m + k) * at(m - j);
      both *= n - k;
      sum(band_of(j), band_of(k)) += both;
      if (k > j) sum(band_of(k), band_of(j)) += both;
    }
  return sum;
}

double worth_for_variance(double rho, double share) {
  return 1 / (1 + 2 * share * share * rho * rho / (1 - rho * rho));
}

double share_in_sample_variance(int n, double rho, double share) {
  return n > 1 ? 1 - share * added_to_mean(n, rho) / (n - 1) : 1;
}

double spectral_density(double phase_rad, double rho, double share) {
  return 1 - share + share * (1 - rho * rho) / (1 - 2 * rho * std::cos(phase_rad) + rho * rho);
}

double added_to_mean(int n, double rho) {
  double sum = 0;
  for (int lag = 1; lag < n; ++lag) sum += 2 * (1 - static_cast<double>(lag) / n) * std::pow(rho, lag);
  return sum;
}

}  // namespace fit::explain::model
