// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Code disk tilted on its axis: an ellipse, two waves a turn.
Mechanism make_encoder_second_harmonic() {
  Mechanism m;
  m.id = "encoder-second-harmonic";
  m.cause = "the code disk is tilted on its axis and looks like an ellipse";
  m.coordinate = Coordinate::beam;
  m.geometric = true;
  m.formula_error = 0.05;
  m.parameters = {{.name = "amplitude_deg", .typical = 0.08},
                  {.name = "phase_deg", .role = Parameter::Role::phase}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.beam_rad = p[0] * rad_per_deg * std::sin(2 * c.beam_rad + p[1] * rad_per_deg)};
  };
  m.says = [](const Finding& f) {
    return "Beam angles swing twice a turn by " + with_uncertainty(f.at("amplitude_deg"), "deg") +
           ": the code disk is tilted on its axis.";
  };
  m.separate = "look at both edges of several targets with different beams";
  return m;
}

}  // namespace fit::mechanisms
