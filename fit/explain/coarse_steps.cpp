// SPDX-License-Identifier: MIT
#include "fit/explain/coarse_steps.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

namespace fit::explain {
namespace {

constexpr const char* rounding = "rounding";

/// What coarse output steps do to means where the noise does not fill them: a wave of one step's length
/// (Widrow and Kollar, Quantization Noise (2008), ch. 4; higher harmonics fade with the square of their
/// order).
Mechanism bias_of_rounding(double step_mm, double sigma_mm) {
  Mechanism m;
  m.id = rounding;
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

/// The coarsest step of which nearly all ranges are a multiple, and what that gains over any whole number.
struct Steps {
  int step_mm = 1;
  double gain = 0;
};
std::optional<Steps> coarsest(const Reduced& reduced) {
  constexpr double fewest = 200, nearly_all = 0.97;
  constexpr double log_of_exception = 5;  // how improbable a range beside the steps is
  std::optional<Steps> best;
  for (int q = 2; q <= 24; ++q) {
    const auto of_step = reduced.remainder.begin() + q * 25;
    double all = 0;
    for (auto count = of_step; count != of_step + q; ++count) all += static_cast<double>(*count);
    const auto most = static_cast<double>(*std::max_element(of_step, of_step + q));
    if (all < fewest || most < nearly_all * all) continue;
    best = {q, most * std::log(q) - (all - most) * log_of_exception};
  }
  return best;
}

}  // namespace

void find_coarse_steps(Reduced& reduced, double sigma_mm, SpreadResult& result) {
  constexpr double improbable = 10;  // gain: a mechanism and its size, and single samples that decide
  const std::optional<Steps> found = coarsest(reduced);
  if (!found || found->gain < improbable) return;
  // A parked target without noise repeats itself too: then its spread is far below the step.
  if (sigma_mm < 0.25 * found->step_mm && reduced.cells.size() < 50) return;
  Suspect suspect;
  suspect.mechanism = find_mechanism(rounding);
  suspect.gain = found->gain;
  suspect.evidence = suspect.gain - 4;
  suspect.parameters = {{"step_mm", {static_cast<double>(found->step_mm), 0}}};
  result.accepted.push_back(suspect);
  reduced.output_step_mm = found->step_mm;
  reduced.empirical.push_back(bias_of_rounding(reduced.output_step_mm, sigma_mm));
}

}  // namespace fit::explain
