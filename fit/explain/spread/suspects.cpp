// SPDX-License-Identifier: MIT
#include "fit/explain/spread/suspects.hpp"

#include <algorithm>
#include <cmath>

namespace fit::explain::spread {

Suspect suspected(const char* id) {
  Suspect suspect;
  suspect.mechanism = find_mechanism(id);
  return suspect;
}

double price_of_size(double gain) { return 0.5 * std::log(1 + 2 * std::max(0.0, gain)) + 0.7; }

}  // namespace fit::explain::spread
