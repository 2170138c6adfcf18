// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/forms/whole_axis.hpp"

namespace fit::explain::forms {

// A scale that changes evenly along the range: a time base that is not linear. Legendre's polynomials up to
// the second: wherever it is zero and steepest. `at`: the middle; `length`: from there to the ends.
Form make_bend() {
  Form f;
  f.id = "bend";
  f.terms = [](const Shape&) { return 3; };
  f.basis = [](const Shape& s, double x, int term) {
    const double u = (x - s.at) / s.length;
    return term == 0 ? 1 : term == 1 ? u : 1.5 * u * u - 0.5;
  };
  f.along = [](const Axis& axis) { return all_along(axis, Coordinate::range); };
  f.says = [](const Shape& s, const Course& c) {
    const double between = 1.5 * s.values.back() * c.scale;
    return Described{"the " + c.what + " bends along " + c.coordinate + ": at both ends, " +
                         rounded(c.low, 4) + " and " + rounded(c.high, 4) + c.unit_of_coordinate +
                         ", it is " + rounded(std::abs(between), 3) + c.unit +
                         (between < 0 ? " less" : " more") + " than half way between",
                     c.low, c.high};
  };
  return f;
}

}  // namespace fit::explain::forms
