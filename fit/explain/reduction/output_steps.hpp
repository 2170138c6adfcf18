// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

namespace fit::explain {

/// Ranges that come in steps, mm, each rounded to a whole millimetre after it, and normal noise of that
/// standard deviation before both. Noise that fills the steps leaves a variance of step^2 / 12; where it does
/// not, mean and variance change with the place between two steps (Widrow and Kollar, Quantization Noise
/// (2008), ch. 4).
struct OutputSteps {
  double step_mm = 1, first_mm = 0;
  double sigma_mm = 1e9;

  /// By which means at that range are shifted.
  [[nodiscard]] double bias_mm(double range_mm) const { return rounded_at(range_mm).bias_mm; }
  /// What is added there to the variance of a sample.
  [[nodiscard]] double variance_mm2(double range_mm) const { return rounded_at(range_mm).variance_mm2; }
  /// The range of which readings have that mean, about.
  [[nodiscard]] double place_of(double mean_mm) const;
  /// Samples that were read off together.
  struct Scatter {
    double mean_mm = 0, variance_mm2 = 0, degrees_of_freedom = 0;
  };
  /// Standard deviation of the noise before rounding that scatters like that behind it, where the means lie
  /// between two steps.
  [[nodiscard]] double noise_of(const std::vector<Scatter>& readings) const;

 private:
  struct Rounded {
    double bias_mm = 0, variance_mm2 = 0;
  };
  [[nodiscard]] Rounded rounded_at(double range_mm) const;
};

}  // namespace fit::explain
