// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Code disk off the mirror's axis: (e/R) sin(a - a_e); 20 um on 20 mm give 0.115 deg (celeramotion.com,
// encoder FAQ).
Mechanism make_encoder_eccentricity() {
  Mechanism m;
  m.id = "encoder-eccentricity";
  m.cause = "the code disk sits off the mirror's axis";
  m.coordinate = Coordinate::beam;
  m.geometric = true;
  m.formula_error = 0.05;
  m.parameters = {{.name = "amplitude_deg", .typical = 0.15},
                  {.name = "phase_deg", .role = Parameter::Role::phase}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.beam_rad = p[0] * rad_per_deg * std::sin(c.beam_rad + p[1] * rad_per_deg)};
  };
  m.says = [](const Finding& f) {
    return "The code disk sits " + with_uncertainty(f.at("amplitude_deg"), "deg") +
           " off the mirror's axis; it bends angles most at beam " +
           rounded(wrap_angle(pi / 2 - f.at("phase_deg").value * rad_per_deg) * deg_per_rad, 3) +
           " deg and opposite it.";
  };
  m.separate = "look at one target with different beams: turn the stage, keep the target";
  return m;
}

}  // namespace fit::mechanisms
