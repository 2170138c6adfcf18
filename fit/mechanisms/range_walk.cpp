// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A fixed threshold fires later on a weak echo. Empirical form w exp(-I/I0) (Zhao et al., the confluent form
// of their eq. 14 at large I); the linear-edge form 1/A looks the same over a decade.
Mechanism make_range_walk() {
  Mechanism m;
  m.id = "range-walk";
  m.cause = "weak echoes cross the receiver's threshold later";
  m.coordinate = Coordinate::intensity;
  m.parameters = {
      {.name = "amplitude_mm", .typical = 25},
      {.name = "intensity_scale", .role = Parameter::Role::shape, .lower = 80, .upper = 2500, .starts = 8}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = std::isfinite(c.intensity) ? p[0] * std::exp(-c.intensity / p[1]) : 0};
  };
  m.says = [](const Finding& f) {
    return "Weak echoes read " + std::string(f.at("amplitude_mm").value > 0 ? "long" : "short") + ": up to " +
           rounded(std::abs(f.largest_mm), 2) + " mm at " + rounded(f.largest_at, 3) +
           " counts, falling by 1/e every " + rounded(f.at("intensity_scale").value, 2) +
           " counts, because a weak echo crosses the threshold later.";
  };
  m.separate = "change the target's reflectance at a fixed distance: only a walk follows the echo's strength";
  return m;
}

}  // namespace fit::mechanisms
