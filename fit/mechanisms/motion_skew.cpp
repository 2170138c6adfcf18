// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// The mirror sweeps while the stage turns: beam k is seen at theta + rate * s_k. It has no free size.
Mechanism make_motion_skew() {
  Mechanism m;
  m.id = "motion-skew";
  m.cause = "the stage turns on while the mirror sweeps, so later beams are seen at later stage angles";
  m.coordinate = Coordinate::stage_rate;
  m.geometric = true;
  m.formula_error = 0.02;
  m.parameters = {{.name = "share", .typical = 0.05, .expected = 1}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.stage_rad = p[0] * c.stage_rate_rad_s * c.beam_time_s};
  };
  m.says = [](const Finding& f) {
    return "Later beams of a scan are seen at later stage angles while the stage turns (" +
           with_uncertainty({100 * f.at("share").value, 100 * f.at("share").u}, "%") +
           " of rate times beam time): scans are skewed by motion.";
  };
  m.separate = "turn at two rates, both ways";
  return m;
}

}  // namespace fit::mechanisms
