// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/forms/whole_axis.hpp"

namespace fit::explain::forms {

// A scale that changes evenly along the range: a time base that is not linear. Legendre's second polynomial,
// as an offset and a scale have names. `at`: the middle; `length`: from there to the ends.
Form make_bend() {
  Form f;
  f.id = "bend";
  f.basis = [](const Shape& s, double x, int) { return 1.5 * std::pow((x - s.at) / s.length, 2) - 0.5; };
  f.along = [](const Axis& axis) { return all_along(axis, Coordinate::range); };
  f.says = [](const Shape& s, const Course& c) {
    const double between = 1.5 * s.values.front() * c.scale;
    return Described{"the " + c.what + " bends along " + c.coordinate + ": at both ends, " +
                         rounded(c.low, 4) + " and " + rounded(c.high, 4) + c.unit_of_coordinate +
                         ", it is " + rounded(std::abs(between), 3) + c.unit +
                         (between < 0 ? " less" : " more") + " than half way between",
                     c.low, c.high};
  };
  return f;
}

}  // namespace fit::explain::forms
