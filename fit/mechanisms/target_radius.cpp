// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A round target is thicker or thinner than the bench file says.
Mechanism make_target_radius() {
  Mechanism m;
  m.id = "target-radius";
  m.cause = "a round target has another radius than the bench file says";
  m.coordinate = Coordinate::target;
  m.one_target = true;
  m.targets = Targets::round;
  m.geometric = true;
  m.parameters = {{.name = "thicker_mm", .typical = 5}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = -p[0] * range_per_mm_out(c.cos_incidence)};
  };
  m.displaces = [](std::span<const double> p) { return Displacement{.thicker_mm = p[0]}; };
  m.looks_like = {"target-offset"};  // where only its middle is met
  m.says = [](const Finding& f) {
    const Estimate thicker = f.at("thicker_mm");
    return "The radius of target '" + f.target + "' is " +
           with_uncertainty({std::abs(thicker.value), thicker.u}, "mm") +
           (thicker.value > 0 ? " larger" : " smaller") +
           " than the bench file says, which its uncertainty does not allow.";
  };
  m.separate = "measure the round target with a calliper";
  return m;
}

}  // namespace fit::mechanisms
