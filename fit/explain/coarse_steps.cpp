// SPDX-License-Identifier: MIT
#include "fit/explain/coarse_steps.hpp"

#include <cmath>

#include "fit/explain/spread/ids.hpp"

namespace fit::explain {
namespace {

/// What coarse output steps do to means where the noise does not fill them: a wave of one step's length
/// (Widrow and Kollar, Quantization Noise (2008), ch. 4; higher harmonics fade with the square of their
/// order).
Mechanism bias_of_rounding(double step_mm, double sigma_mm) {
  Mechanism m;
  m.id = spread::ids::rounding;
  m.coordinate = Coordinate::range;
  m.formula_error = 0;
  m.act = [step_mm, sigma_mm](const Circumstances& c, std::span<const double>) {
    double sum = 0;
    for (int k = 1; k <= 6; ++k) {
      const double w = 2 * pi * k / step_mm;
      const double fades = std::exp(-0.5 * w * w * sigma_mm * sigma_mm);
      sum += (k % 2 == 1 ? -1 : 1) * fades * step_mm / (pi * k) * std::sin(w * c.range_mm);
    }
    return Effect{.range_mm = sum};
  };
  return m;
}

}  // namespace

void add_bias_of_coarse_steps(const SpreadResult& spread, Reduced& reduced) {
  for (const Suspect& suspect : spread.accepted)
    if (suspect.mechanism->id == spread::ids::rounding) {
      reduced.output_step_mm = suspect.parameters.at("step_mm").value;
      reduced.empirical.push_back(bias_of_rounding(reduced.output_step_mm, spread.sigma_mm));
    }
}

}  // namespace fit::explain
