// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Glossy targets: the intensity peaks square on.
Mechanism make_specular() {
  Mechanism m;
  m.id = "specular";
  m.cause = "a glossy target reflects most of the light like a mirror";
  m.observable = Observable::intensity;
  m.coordinate = Coordinate::incidence;
  m.of_surfaces = true;
  m.parameters = {{.name = "gain", .typical = 3, .sign = 1}, log_shape("width_deg", 0.5, 15, 6)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double away = c.incidence_rad * deg_per_rad / p[1];
    return Effect{.log_echo = std::log1p(std::max(-0.9, p[0]) * std::exp(-away * away))};
  };
  m.shows = [](const Finding& f, const Recorded& r) {
    const double reach = 1.5 * f.at("width_deg").value;
    return std::vector<Interval>{{Coordinate::incidence, std::max(r.from, -reach), std::min(r.to, reach)}};
  };
  m.says = [](const Finding& f) {
    const Estimate gain = f.at("gain");
    const std::string brighter = gain.value < 0.5 ? with_uncertainty({100 * gain.value, 100 * gain.u}, "%")
                                                  : "a factor of " + rounded(1 + gain.value, 2);
    return "Square on, " + (f.target.empty() ? "targets are" : "target '" + f.target + "' is") +
           " brighter by " + brighter + " within " + with_uncertainty(f.at("width_deg"), "deg") +
           (f.target.empty() ? ": they are glossy." : ": it is glossy.");
  };
  m.separate = "turn the target by one or two degrees";
  return m;
}

}  // namespace fit::mechanisms
