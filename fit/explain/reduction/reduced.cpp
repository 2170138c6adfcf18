// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/explain/reduction/reduce.hpp"
#include "fit/numeric/median.hpp"

namespace fit::explain {

std::size_t Reduced::smooth_cells() const {
  return static_cast<std::size_t>(std::ranges::count_if(cells, &Cell::smooth));
}

double Reduced::typical_sigma_mm() const {
  std::vector<double> sigmas;
  for (const Group& group : groups) sigmas.push_back(group.sigma_mm);
  return median_of(sigmas);
}

Scene Reduced::scene_of(const Group& group, const Nuisance& nuisance) const {
  return {bench, nuisance, capture_of(group), absent[static_cast<std::size_t>(group.capture)]};
}

}  // namespace fit::explain
