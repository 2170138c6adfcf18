// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <cstdint>

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

/// Where distances come in coarse steps, a cell's variance and memory depend on where its mean lies between
/// two of them. What makes less of a difference than that is not believed.
void distrust_beside_coarse_steps(const Reduced& reduced, SpreadResult& result) {
  if (!is_accepted(result, ids::rounding)) return;
  // Of the variance; its log-likelihood grows by a quarter of the share's square a sample.
  constexpr double share = 0.05;
  const double least = share * share / 4 * static_cast<double>(reduced.samples);
  std::erase_if(result.accepted, [&](const Suspect& s) {
    const Observable shows_in = s.mechanism->observable;
    const bool of_noise = shows_in == Observable::range_variance || shows_in == Observable::time_correlation;
    return of_noise && s.gain < least;
  });
}

}  // namespace fit::explain::spread
