// SPDX-License-Identifier: MIT
#include "rig/runner/surface_echoes.hpp"

#include <cmath>

#include "rig/procedure/procedure_value.hpp"

namespace rig {
namespace {

// Two surfaces whose reflectances differ by so much return different echoes from one distance.
constexpr double very_different = 2, same_echo = 1.03, same_distance = 0.02;

}  // namespace

std::string SurfaceEchoes::contradiction(const std::string& target, const Surface& here) {
  auto& known = known_[target];
  for (const Surface& other : known) {
    if (std::abs(other.distance_mm - here.distance_mm) > same_distance * here.distance_mm) continue;
    const bool lighter = here.reflectance > other.reflectance;
    const double factor =
        lighter ? here.reflectance / other.reflectance : other.reflectance / here.reflectance;
    const double stronger = lighter ? here.intensity / other.intensity : other.intensity / here.intensity;
    if (factor >= very_different && stronger < same_echo)
      return "'" + target + "' does not look as requested: its echo is " + rounded_text(here.intensity, 0) +
             ", that of a surface of reflectance " + to_text(other.reflectance) + " was " +
             rounded_text(other.intensity, 0) + ", and " + to_text(here.reflectance) + " is requested.";
  }
  known.push_back(here);
  return "";
}

}  // namespace rig
