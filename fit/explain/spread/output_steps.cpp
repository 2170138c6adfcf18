// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain::spread {

void output_steps(const Reduced& reduced, SpreadResult& result) {
  double best_step = 1, share = 0, total = 0;
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
  if (best_step < 2) return;
  // A parked target without noise repeats itself too: then its spread is far below the step.
  double typical = 0;
  for (const Group& group : reduced.groups)
    typical += group.sigma_mm / static_cast<double>(reduced.groups.size());
  if (typical < 0.25 * best_step && reduced.cells.size() < 50) return;
  Suspect suspect = suspected(ids::rounding);
  suspect.gain = share * std::log(best_step) - (total - share) * 5;
  suspect.evidence = suspect.gain - 4;
  suspect.parameters = {{"step_mm", {best_step, 0}}};
  if (suspect.evidence >= accept_rare_at) result.accepted.push_back(suspect);
}

}  // namespace fit::explain::spread
