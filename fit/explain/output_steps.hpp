// SPDX-License-Identifier: MIT
#pragma once

namespace fit::explain {

/// Ranges that come in steps, mm, and noise of that standard deviation before they are rounded (Widrow and
/// Kollar, Quantization Noise (2008), ch. 4). Noise that fills the steps leaves a variance of step^2 / 12;
/// where it does not, mean and variance change with the place between two steps.
struct OutputSteps {
  double step_mm = 1, first_mm = 0;
  double sigma_mm = 1e9;

  /// By which means at that range are shifted.
  [[nodiscard]] double bias_mm(double range_mm) const;
  /// What is added there to the variance of a sample.
  [[nodiscard]] double variance_mm2(double range_mm) const;
  /// Standard deviation of the noise whose samples scatter by so much after rounding, averaged over a step.
  [[nodiscard]] double noise_of(double scatter_mm2) const;
};

}  // namespace fit::explain
