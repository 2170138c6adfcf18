// SPDX-License-Identifier: MIT
#include "fit/beam_sector.hpp"

namespace fit::mechanisms {

// Dirt on the window dims a sector of beams.
Mechanism make_window_dirt() {
  Mechanism m;
  m.id = "window-dirt";
  m.cause = "the window is dirty over a sector of beams";
  m.observable = Observable::intensity;
  m.coordinate = Coordinate::beam;
  m.parameters = {
      {.name = "loss", .typical = 0.3, .sign = 1}, centre_of_sector(), log_shape("width_deg", 2, 40, 4)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double dirt = p[0] * share_of_sector(widths_from_centre(c, p[1], p[2]));
    return Effect{.log_echo = std::log(std::max(0.02, 1 - dirt))};
  };
  m.shows = [](const Finding& f, const Recorded& r) {
    const Interval dirty = sector_of(f, 1.5);
    return std::vector<Interval>{{dirty.coordinate, std::max(r.from, dirty.from), std::min(r.to, dirty.to)}};
  };
  m.says = [](const Finding& f) {
    return "Echoes are dimmer by " + with_uncertainty({100 * f.at("loss").value, 100 * f.at("loss").u}, "%") +
           " around beam " + with_uncertainty(f.at("centre_deg"), "deg") + ": the window is dirty there.";
  };
  m.separate = "wipe the window, or turn the stage: dirt stays with the beam";
  return m;
}

}  // namespace fit::mechanisms
