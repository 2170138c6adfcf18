// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Light over the other wall of an inner corner joins the echo: always long. Dull walls scatter it to each
// other near the corner. A glossy wall sends it on like a mirror, where the beam runs towards the corner, the
// more the weaker its own echo is: over L = c / sin(incidence), until the two echoes come apart.
Mechanism make_multipath() {
  Mechanism m;
  m.id = "multipath";
  m.cause = "near an inner corner light comes back over the other wall";
  m.coordinate = Coordinate::target;
  m.geometric = true;
  m.formula_error = 0.3;
  m.parameters = {{.name = "amplitude_mm", .typical = 25, .sign = 1},
                  log_shape("reach_mm", 40, 600, 6).on(Parameter::Scale::decay),
                  even_shape("gloss", 0, 1, 2).generalising()};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    if (!std::isfinite(c.corner_mm)) return Effect{};
    const double scattered = std::exp(-c.corner_mm / p[1]);
    constexpr double least = 0.02;
    const double towards = (c.along_mm > 0 ? 1 : -1) * c.along_sign * std::sin(c.incidence_rad);
    double mirrored = 0;
    if (towards > least) {
      const double onward = c.corner_mm / towards / p[1];
      mirrored = towards / c.cos_incidence * onward * std::exp(1 - onward);
    }
    return Effect{.range_mm = p[0] * ((1 - p[2]) * scattered + p[2] * mirrored)};
  };
  m.says = [](const Finding& f) {
    if (f.at("gloss").value > 0.5)
      return "Near inner corners walls that the beam meets at a slant read up to " +
             rounded(f.largest_mm, 2) +
             " mm long: they mirror it onto the other wall, whose echo joins theirs.";
    return "Near inner corners walls read up to " + with_uncertainty(f.at("amplitude_mm"), "mm") +
           " long, fading by 1/e every " + with_uncertainty(f.at("reach_mm"), "mm") +
           ": light comes back over the other wall.";
  };
  m.separate = "cover one of the two walls with black cloth";
  return m;
}

}  // namespace fit::mechanisms
