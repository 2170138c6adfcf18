// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A slanted wall stretches the pulse (Soudarissanane et al. 2009); even in the incidence angle.
Mechanism make_incidence_bias() {
  Mechanism m;
  m.id = "incidence-bias";
  m.cause = "a slanted wall stretches the pulse and shifts its trigger";
  m.coordinate = Coordinate::incidence;
  m.formula_error = 0.25;
  m.parameters = {{.name = "amplitude_mm", .typical = 4}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double slope = std::tan(std::min(std::abs(c.incidence_rad), 85 * rad_per_deg));
    return Effect{.range_mm = p[0] * slope * slope};
  };
  m.says = [](const Finding& f) {
    const Estimate a = f.at("amplitude_mm");
    return "Slanted walls read " + std::string(a.value > 0 ? "long" : "short") + ": " +
           with_uncertainty({std::abs(a.value), a.u}, "mm") +
           " at 45 deg of incidence, growing with the square of its tangent.";
  };
  m.separate = "tilt the target and compare with a darker target square on";
  return m;
}

}  // namespace fit::mechanisms
