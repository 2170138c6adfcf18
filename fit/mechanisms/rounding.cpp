// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Results are multiples of a step larger than the millimetre of the protocol.
Mechanism make_rounding() {
  Mechanism m;
  m.id = "rounding";
  m.cause = "the firmware rounds the distance";
  m.observable = Observable::range_distribution;
  m.coordinate = Coordinate::range;
  m.parameters = {{.name = "step_mm", .typical = 4, .sign = 1}};
  m.act = [](const Circumstances&, std::span<const double> p) { return Effect{.output_step_mm = p[0]}; };
  m.says = [](const Finding& f) {
    return "Distances come only in multiples of " + rounded(f.at("step_mm").value, 4) + " mm.";
  };
  m.separate = "look at the histogram of raw distances on a slanted wall";
  return m;
}

}  // namespace fit::mechanisms
