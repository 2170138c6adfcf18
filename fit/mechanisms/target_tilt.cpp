// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A target is turned about its middle, counter-clockwise as every angle of the world frame. Where it is met
// at a slant the range changes by more than in proportion.
Mechanism make_target_tilt() {
  Mechanism m;
  m.id = "target-tilt";
  m.cause = "a target is turned against the bench file";
  m.coordinate = Coordinate::target;
  m.one_target = true;
  m.targets = Targets::flat;
  m.geometric = true;
  m.parameters = {{.name = "tilt_deg", .typical = 0.5}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double slope = std::tan(p[0] * rad_per_deg);
    const double facing = c.cos_incidence + slope * std::sin(c.incidence_rad);
    return Effect{.range_mm = -c.along_sign * slope * c.along_mm * range_per_mm_out(facing)};
  };
  m.displaces = [](std::span<const double> p) { return Displacement{.turn_rad = p[0] * rad_per_deg}; };
  m.says = [](const Finding& f) {
    const Estimate tilt = f.at("tilt_deg");
    return "Target '" + f.target + "' is turned by " +
           with_uncertainty({std::abs(tilt.value), tilt.u}, "deg") +
           (tilt.value > 0 ? " counter-clockwise" : " clockwise") +
           " from where the bench file says, which its uncertainty does not allow.";
  };
  m.separate = "move or turn the target, not the lidar";
  return m;
}

}  // namespace fit::mechanisms
