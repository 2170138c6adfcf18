// SPDX-License-Identifier: MIT
#include "fit/explain/stated_noise.hpp"

namespace fit::explain {

Estimate stated_noise(const Bench& bench) {
  if (const KnownMechanism* known = bench.knows("range-noise")) {
    const auto found = known->parameters.find("sigma_mm");
    if (found != known->parameters.end()) return found->second;
  }
  return {unstated_noise_mm, unstated_noise_mm};
}

}  // namespace fit::explain
