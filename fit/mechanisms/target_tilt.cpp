// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A target is turned about its middle.
Mechanism make_target_tilt() {
  Mechanism m;
  m.id = "target-tilt";
  m.cause = "a target is turned against the bench file";
  m.coordinate = Coordinate::target;
  m.one_target = true;
  m.geometric = true;
  m.parameters = {{.name = "tilt_deg", .typical = 0.5}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = p[0] * rad_per_deg * c.along_mm / std::max(0.05, c.cos_incidence)};
  };
  m.says = [](const Finding& f) {
    return "Target '" + f.target + "' is turned by " + with_uncertainty(f.at("tilt_deg"), "deg") +
           ", more than the bench file's uncertainty allows.";
  };
  m.separate = "move or turn the target, not the lidar";
  return m;
}

}  // namespace fit::mechanisms
