// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Random beam angles: one draw for a scan, a packet or a beam; seen through the range's slope over the angle.
Mechanism make_angle_jitter() {
  Mechanism m;
  m.id = "angle-jitter";
  m.cause = "the mirror's angle is not known exactly from scan to scan";
  m.observable = Observable::range_variance;
  m.coordinate = Coordinate::range_rate;
  m.geometric = true;
  m.parameters = {{.name = "sigma_deg", .typical = 0.1, .largest = 1, .sign = 1},
                  // of the variance that every beam draws for itself, not its whole scan
                  even_shape("own_share", 0, 1, 2).generalising()};
  m.act = [](const Circumstances&, std::span<const double> p) {
    const double variance = p[0] * p[0] * rad_per_deg * rad_per_deg;
    return Effect{.scan_angle_variance_rad2 = variance * (1 - p[1]),
                  .beam_angle_variance_rad2 = variance * p[1]};
  };
  m.looks_like = {"incidence-noise"};                // where every beam draws its own; edges tell
  m.shows = [](const Finding&, const Recorded& r) {  // where the range changes with the angle
    return std::vector<Interval>{{Coordinate::range_rate, r.from, r.from / 2},
                                 {Coordinate::range_rate, r.to / 2, r.to}};
  };
  m.says = [](const Finding& f) {
    return "Beam angles scatter by " + with_uncertainty(f.at("sigma_deg"), "deg") +
           ": walls at a slant are noisier than walls square on at the same range.";
  };
  m.separate = "compare a wall square on with one at a slant, at the same range";
  return m;
}

}  // namespace fit::mechanisms
