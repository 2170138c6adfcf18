// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Worm (period 360/N: 3, 2.5 or 2 deg), wheel or scale off its axis (360 deg), motor (0.06 deg).
Mechanism make_stage_periodic() {
  Mechanism m;
  m.id = "stage-periodic";
  m.cause = "the stage's worm or wheel runs off its axis";
  m.coordinate = Coordinate::stage;
  m.geometric = true;
  m.formula_error = 0.15;
  m.parameters = {{.name = "amplitude_deg", .typical = 0.05},
                  {.name = "phase_deg", .role = Parameter::Role::phase},
                  log_shape("period_deg", 1.5, 360, 240).on(Parameter::Scale::gear)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.stage_rad = p[0] * rad_per_deg *
                               std::sin(2 * pi * c.stage_rad * deg_per_rad / p[2] + p[1] * rad_per_deg)};
  };
  m.says = [](const Finding& f) {
    return "The stage's angle swings by " + with_uncertainty(f.at("amplitude_deg"), "deg") +
           " with a period of " + rounded(f.at("period_deg").value, 3) + " deg of its turn.";
  };
  m.separate = "come to the same angle from both sides, at angles that are not multiples of the period";
  return m;
}

}  // namespace fit::mechanisms
