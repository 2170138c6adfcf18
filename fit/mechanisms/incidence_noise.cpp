// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// The footprint on a slanted surface reaches over r tan(i) times the divergence, which stretches the echo; a
// flatter flank crosses the threshold later or earlier by more (Soudarissanane et al. 2011). Near the lidar
// the beam is as wide as its lens, and the range matters less.
Mechanism make_incidence_noise() {
  Mechanism m;
  m.id = "incidence-noise";
  m.cause = "echoes of slanted surfaces are stretched, and their ranges scatter more";
  m.observable = Observable::range_variance;
  m.coordinate = Coordinate::incidence;
  m.formula_error = 0.2;
  m.parameters = {{.name = "sigma_mm", .typical = 3, .sign = 1},  // at 45 deg and 1 m
                  even_shape("range_exponent", 0, 2.5, 2).generalising(2)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    constexpr double steepest = 12;  // tan 85 deg: beyond, a surface ends within the beam
    const double slant = std::min(steepest, std::abs(std::tan(c.incidence_rad)));
    return Effect{.variance_mm2 = p[0] * p[0] * slant * slant * std::pow(c.range_mm / 1000, p[1])};
  };
  m.looks_like = {"angle-jitter"};  // of beams that draw their angles one by one; edges and scans tell
  m.shows = [](const Finding&, const Recorded& r) {
    return std::vector<Interval>{{Coordinate::incidence, r.from, r.from / 2},
                                 {Coordinate::incidence, r.to / 2, r.to}};
  };
  m.says = [](const Finding& f) {
    return "Ranges of slanted surfaces scatter by " + with_uncertainty(f.at("sigma_mm"), "mm") +
           " more, at 45 deg and 1 m, and with the tangent of the incidence.";
  };
  m.separate =
      "record edges in front of something: an angle that scatters blurs them, a stretched echo does not";
  return m;
}

}  // namespace fit::mechanisms
