// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"
#include "fit/weakest_echo.hpp"

namespace fit::mechanisms {

// A fixed threshold fires later on a weak echo. Empirical form w exp(-I/I0) (Zhao et al., the confluent form
// of their eq. 14 at large I), stretched by an exponent: below one it resembles the logarithm of a Gaussian
// edge and the 1/A of a linear one, whose counts come from a compressing receiver. Never above one: the
// stronger the echo, the less its delay still changes, while a receiver that saturates does the opposite.
// Near the threshold such edges are steeper than any of these, and their weak end is a power of the counts:
// 1/A, and A is a power of the counts of 1.4 to 2.5 behind a compressing receiver.
Mechanism make_range_walk() {
  Mechanism m;
  m.id = "range-walk";
  m.cause = "weak echoes cross the receiver's threshold later";
  m.coordinate = Coordinate::intensity;
  m.formula_error = 0.2;
  m.any_curve = true;
  m.parameters = {{.name = "amplitude_mm", .typical = 25},
                  log_shape("intensity_scale", 30, 2500, 8),
                  log_shape("exponent", 0.35, 1, 4).generalising(1),
                  // of 100 counts over the echo's
                  even_shape("power", 0, 3, 3).generalising()};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    if (!std::isfinite(c.intensity)) return Effect{};
    const double counts = counts_of_echo(c.intensity);
    return Effect{.range_mm =
                      p[0] * std::pow(counts / 100, -p[3]) * std::exp(-std::pow(counts / p[1], p[2]))};
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
