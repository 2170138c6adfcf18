// SPDX-License-Identifier: MIT
#include "fit/explain/output_steps.hpp"

#include <cmath>

#include "fit/explain/reduce.hpp"

namespace fit::explain {

OutputSteps::Rounded OutputSteps::rounded_at(double range_mm) const {
  constexpr double filled = 3, reach = 6;  // steps, and standard deviations
  if (sigma_mm > filled * step_mm) return {0, rounding_mm2 * step_mm * step_mm};
  const double reach_mm = reach * sigma_mm + step_mm;
  double mean = 0, square = 0, below = 0;
  for (double k = std::round((range_mm - reach_mm - first_mm) / step_mm);; ++k) {
    const double level_mm = std::round(first_mm + k * step_mm) - range_mm,
                 end_mm = first_mm + (k + 0.5) * step_mm - range_mm;
    const double up_to = end_mm > reach_mm ? 1 : 0.5 * std::erfc(-end_mm / sigma_mm / std::sqrt(2.0)),
                 share = up_to - below;
    mean += share * level_mm;
    square += share * level_mm * level_mm;
    if (end_mm > reach_mm) break;
    below = up_to;
  }
  return {mean, square - mean * mean - sigma_mm * sigma_mm};
}

double OutputSteps::noise_of(double scatter_mm2) const {
  const auto scatter_of = [this](double sigma) {
    const OutputSteps steps{step_mm, first_mm, sigma};
    constexpr int places = 200;
    double mm2 = sigma * sigma;
    for (int i = 0; i < places; ++i)
      mm2 += steps.variance_mm2(first_mm + (i + 0.5) * (10 + 1.0 / places) * step_mm) / places;
    return mm2;
  };
  double low = 1e-3 * step_mm, high = std::sqrt(scatter_mm2);
  for (int i = 0; i < 30; ++i) {
    const double middle = (low + high) / 2;
    (scatter_of(middle) < scatter_mm2 ? low : high) = middle;
  }
  return high;
}

}  // namespace fit::explain
