// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// The mirror runs fast against the firing clock; right at the index, wrong in proportion away from it.
Mechanism make_angle_scale() {
  Mechanism m;
  m.id = "angle-scale";
  m.cause = "the mirror turns faster or slower than the firing clock assumes";
  m.coordinate = Coordinate::beam;
  m.geometric = true;
  m.formula_error = 0.02;
  m.parameters = {{.name = "scale", .typical = 2e-3}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.beam_rad = p[0] * c.beam_rad};
  };
  m.says = [](const Finding& f) {
    return "Beam angles are in proportion too large by " +
           with_uncertainty({100 * f.at("scale").value, 100 * f.at("scale").u}, "%") + " (" +
           rounded(f.at("scale").value * 90, 2) + " deg at 90 deg).";
  };
  m.separate = "see one target at both ends of the scan";
  return m;
}

}  // namespace fit::mechanisms
