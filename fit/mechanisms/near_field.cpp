// SPDX-License-Identifier: MIT
#include "fit/parasitic_light.hpp"

namespace fit::mechanisms {

// Optical overlap and stray light at short range.
Mechanism make_near_field() {
  Mechanism m;
  m.id = "near-field";
  m.cause = "at short range stray light and partial overlap of the optics shift the echo";
  m.coordinate = Coordinate::range;
  m.formula_error = 0.25;
  m.parameters = {{.name = "amplitude_mm", .typical = 15, .largest = 100},
                  log_shape("reach_mm", 60, 500, 6).on(Parameter::Scale::decay),
                  by_echo()};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = p[0] * std::exp(-c.range_mm / p[1]) * beside_echo(c, p[2])};
  };
  m.says = [](const Finding& f) {
    return "Near targets read " + std::string(f.at("amplitude_mm").value > 0 ? "long" : "short") + ", by " +
           rounded(std::abs(f.largest_mm), 2) + " mm at " + rounded(f.largest_at, 3) +
           " mm, and the effect fades by 1/e every " + with_uncertainty(f.at("reach_mm"), "mm") + ".";
  };
  m.looks_like = {"window-reflection"};  // of which few beams show
  m.separate = "repeat the near distances with a darker target, and at another beam angle";
  return m;
}

}  // namespace fit::mechanisms
