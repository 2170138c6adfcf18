// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/output_steps.hpp"

#include <algorithm>
#include <cmath>

#include "fit/explain/reduction/reduce.hpp"

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

double OutputSteps::place_of(double mean_mm) const {
  double place_mm = mean_mm;
  for (int i = 0; i < 4; ++i) place_mm += 0.7 * (mean_mm - place_mm - bias_mm(place_mm));
  return place_mm;
}

double OutputSteps::noise_of(const std::vector<Scatter>& readings) const {
  double most_mm2 = 0;
  for (const Scatter& one : readings) most_mm2 = std::max(most_mm2, one.variance_mm2);
  double low = 1e-3 * step_mm, high = std::sqrt(most_mm2) + step_mm;
  for (int i = 0; i < 30; ++i) {
    const OutputSteps steps{step_mm, first_mm, (low + high) / 2};
    const double noise_mm2 = steps.sigma_mm * steps.sigma_mm;
    double excess = 0;
    for (const Scatter& one : readings)
      excess += one.degrees_of_freedom *
                (noise_mm2 + steps.variance_mm2(steps.place_of(one.mean_mm)) - one.variance_mm2);
    (excess < 0 ? low : high) = steps.sigma_mm;
  }
  return high;
}

}  // namespace fit::explain
