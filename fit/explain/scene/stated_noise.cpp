// SPDX-License-Identifier: MIT
#include "fit/explain/scene/stated_noise.hpp"

namespace fit::explain {

Estimate stated_noise(const Bench& bench) {
  if (const KnownMechanism* known = bench.knows(constant_noise)) {
    const auto found = known->parameters.find("sigma_mm");
    if (found != known->parameters.end()) return found->second;
  }
  return {unstated_noise_mm, unstated_noise_mm};
}

bool is_constant_noise(const Mechanism& mechanism) { return mechanism.id == constant_noise; }

void state_noise(Bench& bench, double sigma_mm) {
  for (KnownMechanism& known : bench.known)
    if (known.mechanism == constant_noise) known.parameters["sigma_mm"].value = sigma_mm;
}

}  // namespace fit::explain
