// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/wide_beam.hpp"

namespace fit::mechanisms {

// Within half a footprint of an edge the echo is front, back or between (Cooper et al. 2018; physics of the
// footprint: weight Phi(d / w)). A receiver may time all light of the beam: beside an inner corner, where it
// meets both walls, and on a slanted one the range is the mean by light then, which is short.
Mechanism make_mixed_pixel() {
  Mechanism m;
  m.id = "mixed-pixel";
  m.cause = "the beam is wide, and at an edge it meets both surfaces";
  m.observable = Observable::range_distribution;
  m.coordinate = Coordinate::edge_distance;
  m.geometric = true;
  m.formula_error = spread_error;
  // A receiver that favours the first or the stronger of two echoes changes over in less than the beam's
  // width.
  // How light is spread over the beam, and how far counts follow it, differ from device to device.
  m.parameters = {
      {.name = "width_deg", .typical = 0.2, .largest = 1.5, .also = 0.4, .sign = 1, .own_affair = 0.5},
      // of the width: in which ranges change over
      log_shape("mixing", 0.02, 1, 4).generalising(1),
      // how far ranges of slanted walls and inner corners are means by light
      even_shape("averaging", 0, 1, 2).generalising()};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double mixed_rad = p[0] * p[1] * rad_per_deg;
    return Effect{.range_mm = p[2] * spread_at_mm(c, p[0] * rad_per_deg),
                  .footprint_rad = mixed_rad,
                  .light_rad = p[0] * rad_per_deg};
  };
  m.shows = [](const Finding& f, const Recorded&) {
    const double reach = std::max(0.03, 1.5 * f.at("width_deg").value);
    return std::vector<Interval>{{Coordinate::edge_distance, -reach, reach}};
  };
  m.says = [](const Finding& f) {
    const bool is_hard = f.parameters.contains("mixing") && f.at("mixing").value < 0.3;
    if (is_hard)
      return "Beside edges echoes are weaker, as a part of the beam goes past: its standard half width is " +
             with_uncertainty(f.at("width_deg"), "deg") +
             ". Ranges change over at once: the receiver takes one of both echoes.";
    return "At edges echoes come from the front, from the back or from between: the beam's standard half "
           "width is " +
           with_uncertainty(f.at("width_deg"), "deg") + ".";
  };
  m.separate = "look at an outer edge with a far background, and at an inner corner";
  return m;
}

}  // namespace fit::mechanisms
