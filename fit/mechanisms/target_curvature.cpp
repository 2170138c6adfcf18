// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A board is bent between its supports (0.5-3 mm).
Mechanism make_target_curvature() {
  Mechanism m;
  m.id = "target-curvature";
  m.cause = "a target is bent";
  m.coordinate = Coordinate::target;
  m.one_target = true;
  m.targets = Targets::flat;
  m.geometric = true;
  m.formula_error = 0.15;
  m.parameters = {{.name = "sagitta_mm", .typical = 4}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double x = c.along_mm / std::max(1.0, c.half_length_mm);
    return Effect{.range_mm = p[0] * (1 - x * x) * range_per_mm_out(c.cos_incidence)};
  };
  m.says = [](const Finding& f) {
    return "Target '" + f.target + "' is bent: its middle stands " +
           with_uncertainty(f.at("sagitta_mm"), "mm") + " off the line between its ends.";
  };
  m.separate = "move or turn the target, not the lidar: a bend goes with it";
  return m;
}

}  // namespace fit::mechanisms
