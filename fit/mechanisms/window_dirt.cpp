// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Dirt on the window dims a sector of beams.
Mechanism make_window_dirt() {
  Mechanism m;
  m.id = "window-dirt";
  m.cause = "the window is dirty over a sector of beams";
  m.observable = Observable::intensity;
  m.coordinate = Coordinate::beam;
  m.parameters = {
      {.name = "loss", .typical = 0.3, .sign = 1},
      {.name = "centre_deg",
       .role = Parameter::Role::shape,
       .lower = -135,
       .upper = 135,
       .starts = 37,
       .logarithmic = false},
      {.name = "width_deg", .role = Parameter::Role::shape, .lower = 2, .upper = 40, .starts = 4}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double away = wrap_angle(c.beam_rad - p[1] * rad_per_deg) * deg_per_rad / p[2];
    return Effect{.log_intensity = std::log(std::max(0.02, 1 - p[0] * std::exp(-away * away / 2)))};
  };
  m.shows = [](const Finding& f, const Recorded& r) {
    const double middle = f.at("centre_deg").value, reach = 1.5 * f.at("width_deg").value;
    return std::vector<Interval>{
        {Coordinate::beam, std::max(r.from, middle - reach), std::min(r.to, middle + reach)}};
  };
  m.says = [](const Finding& f) {
    return "Echoes are dimmer by " + with_uncertainty({100 * f.at("loss").value, 100 * f.at("loss").u}, "%") +
           " around beam " + with_uncertainty(f.at("centre_deg"), "deg") + ": the window is dirty there.";
  };
  m.separate = "wipe the window, or turn the stage: dirt stays with the beam";
  return m;
}

}  // namespace fit::mechanisms
