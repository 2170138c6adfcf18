// SPDX-License-Identifier: MIT
#include "fit/beam_sector.hpp"
#include "fit/parasitic_light.hpp"

namespace fit::mechanisms {

// A glint of the housing overlaps the echo at certain mirror positions (github iliasam/OpenTOFLidar#17).
Mechanism make_window_reflection() {
  Mechanism m;
  m.id = "window-reflection";
  m.cause = "the housing's window reflects part of the pulse at certain beam angles";
  m.coordinate = Coordinate::beam;
  m.formula_error = 0.25;
  m.parameters = {{.name = "amplitude_mm", .typical = 20, .largest = 100},
                  log_shape("reach_mm", 100, 500, 3).on(Parameter::Scale::decay),
                  centre_of_sector(28),
                  log_shape("width_deg", 4, 40, 3),
                  by_echo()};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double away = widths_from_centre(c, p[2], p[3]);
    return Effect{.range_mm = p[0] * std::exp(-c.range_mm / p[1] - away * away / 2) * beside_echo(c, p[4])};
  };
  m.says = [](const Finding& f) {
    return "Near targets read up to " + rounded(std::abs(f.largest_mm), 2) + " mm " +
           std::string(f.largest_mm > 0 ? "long" : "short") + " around beam " +
           with_uncertainty(f.at("centre_deg"), "deg") + ": a reflection from the window.";
  };
  m.looks_like = {"near-field"};  // where no other beams look at near targets
  m.separate = "turn the stage so that other beams look at the same near target";
  return m;
}

}  // namespace fit::mechanisms
