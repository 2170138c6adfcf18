// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/explain/model/unnamed.hpp"

namespace fit::explain::forms {

// A sine of some period: lobes, gears, something that swings.
Form make_wave() {
  Form f;
  f.id = "wave";
  f.terms = [](const Shape&) { return 2; };
  f.basis = [](const Shape& s, double x, int term) {
    const double phase = 2 * pi * x / s.at;
    return term == 0 ? std::sin(phase) : std::cos(phase);
  };
  f.along = [](const Axis& axis) {
    std::vector<Shape> list;
    const double span = axis.high - axis.low,
                 shortest = 2 * span / std::max<double>(1, static_cast<double>(axis.values.size()) - 1);
    if (axis.coordinate == Coordinate::beam) {
      // Whole numbers of lobes in a turn, and any other number: coarse slits, gears.
      for (int lobes = 3; lobes <= 12; ++lobes) list.push_back({.at = 360.0 / lobes});
      for (double cycles = 4; cycles < 20; cycles += 0.4) list.push_back({.at = span / cycles});
    } else if (axis.coordinate == Coordinate::time) {
      for (double turns = 1.5; turns < 12; turns *= 1.08) list.push_back({.at = span / turns});
    }
    std::erase_if(list, [&](const Shape& wave) { return wave.at < shortest; });  // rows show no more
    return list;
  };
  f.says = [](const Shape& s, const Course& c) {
    const Estimate sine = s.coefficient(0), cosine = s.coefficient(1);
    const double amplitude = std::hypot(sine.value, cosine.value);
    const double u = std::hypot(sine.value * sine.u, cosine.value * cosine.u) / std::max(1e-300, amplitude);
    return Described{"the " + c.what + " waves along " + c.coordinate + ": period " + rounded(s.at, 4) +
                         c.unit_of_coordinate + ", amplitude " + c.in_words({amplitude, u}),
                     c.low, c.high};
  };
  return f;
}

}  // namespace fit::explain::forms
