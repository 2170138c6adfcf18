// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Intensity follows K rho cos(i) / r^n behind a compressing receiver (fit/radiometer.hpp, which benches state
// under this name and `rig explain` compares with). As an effect of its own it is a change of that law.
Mechanism make_radiometry() {
  Mechanism m;
  m.id = "radiometry";
  m.cause = "the echo's strength follows another law than the bench file says";
  m.observable = Observable::intensity;
  m.coordinate = Coordinate::intensity;
  m.parameters = {{.name = "log_gain", .typical = 0.5}, {.name = "range_exponent", .typical = 0.5}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.log_intensity = p[0] - p[1] * std::log(std::max(1.0, c.range_mm) / 1000)};
  };
  m.says = [](const Finding& f) {
    return "Echoes fade with the power " + with_uncertainty(f.at("range_exponent"), "") +
           " more of the distance than the bench file says.";
  };
  m.separate = "one target at several distances, and several greys at one distance";
  return m;
}

}  // namespace fit::mechanisms
