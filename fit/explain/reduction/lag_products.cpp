// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/lag_products.hpp"

#include <algorithm>

namespace fit::explain::reduction {

void LagProducts::add(const std::vector<double>& deviation, Group& group) {
  const int scan = static_cast<int>(sums_.size()) - 1;  // scans before this one
  std::vector<double> sum = sums_.back();
  for (std::size_t beam = 0; beam < sum.size(); ++beam) {
    const double d = deviation[beam], product = d * before_[beam];
    group.lagged[0] += d * d;
    group.lagged_squares += product * product;
    sum[beam] += d;
  }
  for (std::size_t band = 1; band < lag_bands.size() && lag_bands[band].first <= scan; ++band) {
    const std::vector<double>&to = sums_[static_cast<std::size_t>(scan - lag_bands[band].first + 1)],
          &from = sums_[static_cast<std::size_t>(std::max(0, scan - lag_bands[band].last))];
    double products = 0;
    for (std::size_t beam = 0; beam < sum.size(); ++beam)
      products += deviation[beam] * (to[beam] - from[beam]);
    group.lagged[band] += products;
  }
  sums_.push_back(std::move(sum));
  before_ = deviation;
}

}  // namespace fit::explain::reduction
