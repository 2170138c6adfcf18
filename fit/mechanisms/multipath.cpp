// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Light over the other wall of an inner corner joins the echo: always long.
Mechanism make_multipath() {
  Mechanism m;
  m.id = "multipath";
  m.cause = "near an inner corner light comes back over the other wall";
  m.coordinate = Coordinate::target;
  m.geometric = true;
  m.formula_error = 0.3;
  m.parameters = {
      {.name = "amplitude_mm", .typical = 25, .sign = 1},
      {.name = "reach_mm", .role = Parameter::Role::shape, .lower = 40, .upper = 600, .starts = 6}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = std::isfinite(c.corner_mm) ? p[0] * std::exp(-c.corner_mm / p[1]) : 0};
  };
  m.says = [](const Finding& f) {
    return "Near inner corners walls read up to " + with_uncertainty(f.at("amplitude_mm"), "mm") +
           " long, fading by 1/e every " + with_uncertainty(f.at("reach_mm"), "mm") +
           ": light comes back over the other wall.";
  };
  m.separate = "cover one of the two walls with black cloth";
  return m;
}

}  // namespace fit::mechanisms
