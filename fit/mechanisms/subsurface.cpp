// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Light enters foam, plastic or wood and comes back late (always long). A way through the material that is as
// long at every angle makes a constant; a layer that sends it back at its own depth is crossed on a longer
// way at a slant, and light that diffuses out from how deep it came is less late. Refraction (n = 1.5) keeps
// both within 1 / cos 42 deg.
Mechanism make_subsurface() {
  Mechanism m;
  m.id = "subsurface";
  m.cause = "light enters the target's material and comes back late";
  m.coordinate = Coordinate::target;
  m.one_target = true;
  m.parameters = {{.name = "depth_mm", .typical = 8, .sign = 1},
                  // the delay there over that square on
                  log_shape("at_grazing", 0.7, 1.4, 3).generalising(1)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = p[0] * std::pow(p[1], 1 - c.cos_incidence * c.cos_incidence)};
  };
  m.says = [](const Finding& f) {
    return "Target '" + f.target + "' reads " + with_uncertainty(f.at("depth_mm"), "mm") +
           " too far square on: light enters its material.";
  };
  m.separate = "stick opaque tape on part of the target: only scattering inside it goes away";
  return m;
}

}  // namespace fit::mechanisms
