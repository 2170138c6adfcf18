// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/explain/model/unnamed.hpp"

namespace fit::explain::forms {

// Another value from some place on: a seam of a scale, a part that was touched.
Form make_step() {
  Form f;
  f.id = "step";
  f.basis = [](const Shape& s, double x, int) { return x > s.at ? 1.0 : 0.0; };
  f.along = [](const Axis& axis) {
    std::vector<Shape> list;
    if (axis.coordinate == Coordinate::incidence || axis.coordinate == Coordinate::temperature) return list;
    for (const double at : axis.between) list.push_back({.at = at});
    return list;
  };
  f.says = [](const Shape& s, const Course& c) {
    const double aside = (c.high - c.low) / 30;
    return Described{"the " + c.what + " steps by " + c.in_words(s.coefficient(0)) + " at " + c.coordinate +
                         " = " + rounded(s.at, 4) + c.unit_of_coordinate,
                     s.at - aside, s.at + aside};
  };
  return f;
}

}  // namespace fit::explain::forms
