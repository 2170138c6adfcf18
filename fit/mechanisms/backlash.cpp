// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Play between worm and wheel: -(B/2) sign of the last move (0.04-0.1 deg on common stages).
Mechanism make_backlash() {
  Mechanism m;
  m.id = "backlash";
  m.cause = "the stage has play: it stops short of the commanded angle from either side";
  m.coordinate = Coordinate::approach;
  m.geometric = true;
  m.parameters = {{.name = "width_deg", .typical = 0.1, .sign = 1}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.stage_rad = -p[0] * rad_per_deg / 2 * c.approach};
  };
  m.says = [](const Finding& f) {
    return "The stage has " + with_uncertainty(f.at("width_deg"), "deg") +
           " of play: the same commanded angle differs by that much when it is approached from the other "
           "side.";
  };
  m.separate = "come to the same angle from both sides";
  return m;
}

}  // namespace fit::mechanisms
