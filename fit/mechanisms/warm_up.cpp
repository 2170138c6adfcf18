// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// The receiver's delay drifts while it warms (Kneip 2009; Ye & Borenstein 2002).
Mechanism make_warm_up() {
  Mechanism m;
  m.id = "warm-up";
  m.cause = "the lidar's electronics drift while they warm up";
  m.coordinate = Coordinate::time;
  m.formula_error = 0.25;
  m.parameters = {{.name = "amplitude_mm", .typical = 10},
                  log_shape("tau_s", 150, 5000, 7).on(Parameter::Scale::decay)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = p[0] * (1 - std::exp(-c.time_s / p[1]))};
  };
  m.set_right_mm = [](std::span<const double> p) { return p[0]; };  // cold or warm
  m.looks_like = {"temperature"};  // that rises as the lidar warms
  m.says = [](const Finding& f) {
    return "Distances drift by " + with_uncertainty(f.at("amplitude_mm"), "mm") +
           " after power-on, with a time constant of " + rounded(f.at("tau_s").value / 60, 2) + " min.";
  };
  m.separate = "heat or cool the lidar after it has warmed up, or power-cycle it warm";
  return m;
}

}  // namespace fit::mechanisms
