// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A fixed threshold fires later on a weak echo. Empirical form w exp(-I/I0) (Zhao et al., the confluent form
// of their eq. 14 at large I), stretched by an exponent: below one it resembles the logarithm of a Gaussian
// edge and the 1/A of a linear one, whose counts come from a compressing receiver. Never above one: the
// stronger the echo, the less its delay still changes, while a receiver that saturates does the opposite.
Mechanism make_range_walk() {
  Mechanism m;
  m.id = "range-walk";
  m.cause = "weak echoes cross the receiver's threshold later";
  m.coordinate = Coordinate::intensity;
  m.formula_error = 0.2;
  m.any_curve = true;
  m.parameters = {
      {.name = "amplitude_mm", .typical = 25},
      {.name = "intensity_scale", .role = Parameter::Role::shape, .lower = 30, .upper = 2500, .starts = 8},
      {.name = "exponent",
       .role = Parameter::Role::shape,
       .expected = 1,
       .lower = 0.35,
       .upper = 1,
       .starts = 4}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = std::isfinite(c.intensity)
                                  ? p[0] * std::exp(-std::pow(std::max(1.0, c.intensity) / p[1], p[2]))
                                  : 0};
  };
  m.says = [](const Finding& f) {
    return "Weak echoes read " + std::string(f.largest_mm > 0 ? "long" : "short") + ": up to " +
           rounded(std::abs(f.largest_mm), 2) + " mm at " + rounded(f.largest_at, 3) +
           " counts, less on stronger echoes, because a weak echo crosses the threshold later.";
  };
  m.separate = "change the target's reflectance at a fixed distance: only a walk follows the echo's strength";
  return m;
}

}  // namespace fit::mechanisms
