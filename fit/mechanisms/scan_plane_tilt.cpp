// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Mirror or mount leans: rays climb by tilt * cos(a - axis), so upright walls are met at r / cos(climb):
// second order. Where the mount leans, the circle seen from above is an ellipse, which bends beams by
// tilt^2/4 sin 2(a - axis); a mirror alone bends none of them.
Mechanism make_scan_plane_tilt() {
  Mechanism m;
  m.id = "scan-plane-tilt";
  m.cause = "the scan plane leans, so that rays climb and meet upright walls farther out";
  m.coordinate = Coordinate::beam;
  m.formula_error = 0.1;
  m.parameters = {{.name = "tilt_squared_deg2", .typical = 4, .sign = 1},
                  even_shape("axis_deg", -90, 90, 12),
                  even_shape("share_of_mount", 0, 1, 2).generalising(1)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double x = c.beam_rad - p[1] * rad_per_deg, tilt2 = p[0] * rad_per_deg * rad_per_deg;
    return Effect{.range_mm = c.range_mm / 2 * tilt2 * std::cos(x) * std::cos(x),
                  .beam_rad = p[2] * tilt2 / 4 * std::sin(2 * x)};
  };
  m.says = [](const Finding& f) {
    const double tilt = std::sqrt(std::max(0.0, f.at("tilt_squared_deg2").value));
    return "The scan plane leans by " + rounded(tilt, 3) + " deg towards beam " +
           with_uncertainty(f.at("axis_deg"), "deg") + ": rays climb and walls read up to " +
           rounded(std::abs(f.largest_mm), 2) + " mm long.";
  };
  m.separate = "find the ray's height on a target with a slit, in front and behind";
  return m;
}

}  // namespace fit::mechanisms
