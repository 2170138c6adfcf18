// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Steps per turn wrong, or steps lost in proportion.
Mechanism make_stage_scale() {
  Mechanism m;
  m.id = "stage-scale";
  m.cause = "the stage turns in proportion more or less than commanded";
  m.coordinate = Coordinate::stage;
  m.geometric = true;
  m.formula_error = 0.02;
  m.parameters = {{.name = "scale", .typical = 2e-3}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.stage_rad = p[0] * c.stage_rad};
  };
  m.says = [](const Finding& f) {
    return "The stage turns " + with_uncertainty({100 * f.at("scale").value, 100 * f.at("scale").u}, "%") +
           " farther than commanded (" + rounded(f.at("scale").value * 360, 2) + " deg a turn).";
  };
  m.separate = "turn the stage a full turn back to the same target";
  return m;
}

}  // namespace fit::mechanisms
