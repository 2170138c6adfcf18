// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "fit/angle.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {

double output_steps(const Reduced& reduced, SpreadResult& result) {
  constexpr double whole_mm = 1;
  double best_step = whole_mm, share = 0, total = 0;
  for (std::size_t q = 2; q <= 24; ++q) {
    double sum = 0;
    std::uint64_t most = 0;
    for (std::size_t r = 0; r < q; ++r) {
      const auto n = static_cast<std::uint64_t>(reduced.remainder[q * 25 + r]);
      sum += static_cast<double>(n);
      most = std::max(most, n);
    }
    if (sum < 200 || static_cast<double>(most) < 0.97 * sum) continue;
    best_step = static_cast<double>(q);
    share = static_cast<double>(most);
    total = sum;
  }
  if (best_step < 2) return whole_mm;
  // A parked target without noise repeats itself too: then its spread is far below the step.
  double typical = 0;
  for (const Group& group : reduced.groups)
    typical += group.sigma_mm / static_cast<double>(reduced.groups.size());
  if (typical < 0.25 * best_step && reduced.cells.size() < 50) return whole_mm;
  Suspect suspect = suspected(ids::rounding);
  suspect.gain = share * std::log(best_step) - (total - share) * 5;
  suspect.evidence = suspect.gain - 4;
  suspect.parameters = {{"step_mm", {best_step, 0}}};
  if (suspect.evidence < accept_rare_at) return whole_mm;
  result.accepted.push_back(suspect);
  return best_step;
}

namespace {

/// By how much of itself a variance changes with the place of the mean between two steps (Widrow & Kollar,
/// Quantization Noise, 2008: first harmonic of a rounded normal variable). Never less than what is left of
/// noise that is not normal, nor more than what the places of many cells leave of it.
double share_of_steps(double sigma_mm, double step_mm) {
  constexpr double least = 0.01, most = 0.1;
  const double in_steps2 = std::pow(sigma_mm / step_mm, 2);
  const double swings = (4 * in_steps2 + 1 / (pi * pi)) * std::exp(-2 * pi * pi * in_steps2);
  return std::clamp(swings / (in_steps2 + 1.0 / 12), least, most);
}

}  // namespace

/// Where distances come in coarse steps, a cell's variance and memory depend on where its mean lies between
/// two of them. What makes less of a difference than that is not believed.
void distrust_beside_coarse_steps(const Reduced& reduced, SpreadResult& result) {
  const auto rounding =
      std::ranges::find_if(result.accepted, [](const Suspect& s) { return is(s, ids::rounding); });
  if (rounding == result.accepted.end()) return;
  // Of the variance; its log-likelihood grows by a quarter of the share's square a sample.
  const double share = share_of_steps(result.sigma_mm, rounding->parameters.at("step_mm").value);
  const double least = share * share / 4 * static_cast<double>(reduced.samples);
  distrust_noise(least, least, result);
}

}  // namespace fit::explain::spread
