// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Delay against housing temperature.
Mechanism make_temperature() {
  Mechanism m;
  m.id = "temperature";
  m.cause = "the receiver's delay depends on the housing's temperature";
  m.coordinate = Coordinate::temperature;
  m.formula_error = 0.15;
  m.parameters = {{.name = "slope_mm_per_k", .typical = 0.7}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = std::isfinite(c.temperature_k) ? p[0] * c.temperature_k : 0};
  };
  m.set_right_mm = [](std::span<const double> p) { return 7 * p[0]; };  // K
  m.looks_like = {"warm-up"};  // where the room's temperature does not change
  m.says = [](const Finding& f) {
    return "Distances follow the housing's temperature by " +
           with_uncertainty(f.at("slope_mm_per_k"), "mm/K") + ".";
  };
  m.separate = "heat or cool the lidar after it has warmed up, or power-cycle it warm";
  return m;
}

}  // namespace fit::mechanisms
