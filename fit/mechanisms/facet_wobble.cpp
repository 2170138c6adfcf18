// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Mirror faces that are not equally far from the axis: the scan's number modulo the number of faces.
Mechanism make_facet_wobble() {
  Mechanism m;
  m.id = "facet-wobble";
  m.cause = "the faces of the mirror are not equally far from its axis";
  m.coordinate = Coordinate::scan_seq;
  m.parameters = {{.name = "amplitude_mm", .typical = 3},
                  {.name = "phase_deg", .role = Parameter::Role::phase},
                  even_shape("facets", 2, 8, 7).on(Parameter::Scale::count)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double facets = std::round(p[2]);
    return Effect{.range_mm = p[0] * std::sin(2 * pi * c.seq / facets + p[1] * rad_per_deg)};
  };
  m.says = [](const Finding& f) {
    return "Every " + rounded(std::round(f.at("facets").value), 2) + " scans the distances repeat, " +
           with_uncertainty(f.at("amplitude_mm"), "mm") + " up and down: the mirror's faces differ.";
  };
  m.separate = "switch the lamps off: mains light can imitate two faces";
  return m;
}

}  // namespace fit::mechanisms
