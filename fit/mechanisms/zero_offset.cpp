// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Electronic and optical delays, window glass, definition of the origin: a constant (units of one series
// differ by 10-20 mm: github SICKAG/sick_scan#86).
Mechanism make_zero_offset() {
  Mechanism m;
  m.id = "zero-offset";
  m.cause =
      "every distance is off by the same amount: a delay in the receiver or another origin of the scale";
  m.coordinate = Coordinate::target;
  m.formula_error = 0;
  m.parameters = {{.name = "offset_mm", .typical = 12}};
  m.act = [](const Circumstances&, std::span<const double> p) { return Effect{.range_mm = p[0]}; };
  m.says = [](const Finding& f) {
    return "All distances read " + with_uncertainty(f.at("offset_mm"), "mm") + " off, whatever the target.";
  };
  m.separate =
      "turn the stage so that the lidar sees the same targets from opposite sides, or move the target by "
      "known steps";
  return m;
}

}  // namespace fit::mechanisms
