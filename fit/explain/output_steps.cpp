// SPDX-License-Identifier: MIT
#include "fit/explain/output_steps.hpp"

#include <cmath>

#include "fit/explain/reduce.hpp"

namespace fit::explain {
namespace {

/// Of the sawtooth by which rounding is off.
struct Harmonic {
  double size_mm, faded, phase_rad;
};
constexpr int harmonics = 6;
Harmonic harmonic(const OutputSteps& steps, int k, double range_mm) {
  const double w = 2 * pi * k / steps.step_mm;
  return {(k % 2 == 1 ? -1 : 1) * steps.step_mm / (pi * k),
          std::exp(-0.5 * w * w * steps.sigma_mm * steps.sigma_mm), w * (range_mm - steps.first_mm)};
}

}  // namespace

double OutputSteps::bias_mm(double range_mm) const {
  double sum = 0;
  for (int k = 1; k <= harmonics; ++k) {
    const Harmonic h = harmonic(*this, k, range_mm);
    sum += h.size_mm * h.faded * std::sin(h.phase_rad);
  }
  return sum;
}

double OutputSteps::variance_mm2(double range_mm) const {
  const double filled_mm2 = rounding_mm2 * step_mm * step_mm;
  if (sigma_mm > 2 * step_mm)
    return filled_mm2;  // as of nearly every lidar: every cell asks, and waves are slow
  const double bias = bias_mm(range_mm);
  double sum = filled_mm2 - bias * bias;
  for (int k = 1; k <= harmonics; ++k) {
    const Harmonic h = harmonic(*this, k, range_mm);
    const double of_noise = 4 * sigma_mm * sigma_mm * h.faded, sign = k % 2 == 1 ? -1 : 1;
    sum += sign * (of_noise + h.size_mm * h.size_mm * h.faded) * std::cos(h.phase_rad);
  }
  return sum;
}

double OutputSteps::noise_of(double scatter_mm2) const {
  const auto scatter_of = [this](double sigma) {
    const OutputSteps steps{step_mm, first_mm, sigma};
    double mm2 = sigma * sigma + rounding_mm2 * step_mm * step_mm;
    for (int k = 1; k <= harmonics; ++k) {
      const Harmonic h = harmonic(steps, k, 0);
      mm2 -= std::pow(h.size_mm * h.faded, 2) / 2;
    }
    return mm2;
  };
  double low = 0, high = std::sqrt(scatter_mm2);
  for (int i = 0; i < 40; ++i) {
    const double middle = (low + high) / 2;
    (scatter_of(middle) < scatter_mm2 ? low : high) = middle;
  }
  return high;
}

}  // namespace fit::explain
