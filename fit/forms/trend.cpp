// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/forms/whole_axis.hpp"

namespace fit::explain::forms {

// It grows evenly in time: what drifts. What grows evenly along other coordinates is a scale, which has a
// name. `at`: where it is zero, the middle; `length`: from there to the ends.
Form make_trend() {
  Form f;
  f.id = "trend";
  f.basis = [](const Shape& s, double x, int) { return (x - s.at) / s.length; };
  f.along = [](const Axis& axis) { return all_along(axis, Coordinate::time); };
  f.says = [](const Shape& s, const Course& c) {
    const Estimate half = s.coefficient(0);
    return Described{"the " + c.what + (half.value < 0 ? " falls" : " grows") + " evenly along " +
                         c.coordinate + ", by " + c.in_words({2 * std::abs(half.value), 2 * half.u}) +
                         " from " + rounded(c.low, 4) + " to " + rounded(c.high, 4) + c.unit_of_coordinate,
                     c.low, c.high};
  };
  return f;
}

}  // namespace fit::explain::forms
