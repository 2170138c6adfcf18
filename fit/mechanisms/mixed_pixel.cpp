// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Within half a footprint of an edge the echo is front, back or between (Cooper et al. 2018; physics of the
// footprint: weight Phi(d / w)).
Mechanism make_mixed_pixel() {
  Mechanism m;
  m.id = "mixed-pixel";
  m.cause = "the beam is wide, and at an edge it meets both surfaces";
  m.observable = Observable::range_distribution;
  m.coordinate = Coordinate::edge_distance;
  m.geometric = true;
  // A receiver that favours the stronger of two echoes changes over in less than the beam's width.
  m.parameters = {{.name = "width_deg", .typical = 0.2, .sign = 1, .own_affair = 1.5}};
  m.act = [](const Circumstances&, std::span<const double> p) {
    return Effect{.footprint_rad = p[0] * rad_per_deg};
  };
  m.shows = [](const Finding& f, const Recorded&) {
    const double reach = std::max(0.03, 1.5 * f.at("width_deg").value);
    return std::vector<Interval>{{Coordinate::edge_distance, -reach, reach}};
  };
  m.says = [](const Finding& f) {
    return "At edges echoes come from the front, from the back or from between: the beam's standard half "
           "width is " +
           with_uncertainty(f.at("width_deg"), "deg") + ".";
  };
  m.separate = "look at an outer edge with a far background, and at an inner corner";
  return m;
}

}  // namespace fit::mechanisms
