// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Bearing runs out: the axis travels a circle of 5-500 um. In a planar model the same as an arm of that
// length.
Mechanism make_stage_eccentricity() {
  Mechanism m;
  m.id = "stage-eccentricity";
  m.cause = "the stage's axis travels a small circle";
  m.coordinate = Coordinate::stage;
  m.geometric = true;
  m.formula_error = 0.01;  // a circle is a circle
  m.parameters = {{.name = "amplitude_mm", .typical = 3},
                  {.name = "phase_deg", .role = Parameter::Role::phase}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double at = c.stage_rad + p[1] * rad_per_deg;
    return Effect{.origin_mm = {p[0] * std::cos(at), p[0] * std::sin(at)}};
  };
  m.looks_like = {"lidar-arm", mount_offset};
  m.says = [](const Finding& f) {
    return "The stage's axis travels a circle of " + with_uncertainty(f.at("amplitude_mm"), "mm") + ".";
  };
  m.separate = "measure the axis with a dial gauge: a planar scan cannot tell it from the mount";
  return m;
}

}  // namespace fit::mechanisms
