// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Light enters foam, plastic or wood and comes back late: a constant of the material (always long).
Mechanism make_subsurface() {
  Mechanism m;
  m.id = "subsurface";
  m.cause = "light enters the target's material and comes back late";
  m.coordinate = Coordinate::target;
  m.one_target = true;
  m.parameters = {{.name = "depth_mm", .typical = 8, .sign = 1}};
  m.act = [](const Circumstances&, std::span<const double> p) { return Effect{.range_mm = p[0]}; };
  m.says = [](const Finding& f) {
    return "Target '" + f.target + "' reads " + with_uncertainty(f.at("depth_mm"), "mm") +
           " too far at every angle: light enters its material.";
  };
  m.separate = "stick opaque tape on part of the target: only scattering inside it goes away";
  return m;
}

}  // namespace fit::mechanisms
