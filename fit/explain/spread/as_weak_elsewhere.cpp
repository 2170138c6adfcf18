// SPDX-License-Identifier: MIT
#include "fit/explain/spread/as_weak_elsewhere.hpp"

#include <algorithm>
#include <limits>

namespace fit::explain::spread {

bool is_as_weak_elsewhere(const std::vector<Echoes>& found_on,
                          const std::vector<double>& intensities_elsewhere) {
  constexpr double hardly_stronger = 1.01;
  double weakest = std::numeric_limits<double>::infinity();
  for (const double intensity : intensities_elsewhere) weakest = std::min(weakest, intensity);
  double all = 0, met = 0;
  for (const Echoes& echoes : found_on) {
    all += echoes.weight;
    if (weakest <= hardly_stronger * echoes.intensity) met += echoes.weight;
  }
  return 2 * met > all;
}

}  // namespace fit::explain::spread
