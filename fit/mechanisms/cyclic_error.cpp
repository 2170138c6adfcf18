// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Crosstalk of clock or modulation into the receiver: periodic in range (Lichti & Licht 2006).
Mechanism make_cyclic_error() {
  Mechanism m;
  m.id = "cyclic-error";
  m.cause = "the counter's own clock leaks into the receiver";
  m.coordinate = Coordinate::range;
  m.formula_error = 0.15;
  m.parameters = {{.name = "amplitude_mm", .typical = 6},
                  {.name = "phase_deg", .role = Parameter::Role::phase},
                  log_shape("period_mm", 90, 3200, 60).on(Parameter::Scale::wavelength)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = p[0] * std::sin(2 * pi * c.range_mm / p[2] + p[1] * rad_per_deg)};
  };
  m.says = [](const Finding& f) {
    return "Distances swing by " + with_uncertainty(f.at("amplitude_mm"), "mm") + " with a period of " +
           with_uncertainty(f.at("period_mm"), "mm") +
           " in range: the counter's clock leaks into the receiver.";
  };
  m.separate = "sweep the range in small steps that do not fit the period";
  return m;
}

}  // namespace fit::mechanisms
