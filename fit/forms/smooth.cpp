// SPDX-License-Identifier: MIT
#include "fit/explain/model/unnamed.hpp"
#include "fit/forms/cosines.hpp"

namespace fit::explain::forms {

// Any smooth curve. `length`: its correlation length as a share of the span.
Form make_smooth() {
  Form f;
  f.id = "smooth";
  f.scaled = true;
  f.terms = [](const Shape& s) { return cosines_of(s.length); };
  f.basis = [](const Shape&, double x, int term) { return cosine(x, term); };
  f.shares = [](const Shape& s) { return shares_of_cosines(s.length); };
  f.along = [](const Axis& axis) {
    std::vector<Shape> list;
    for (const double length : {0.25, 0.1})
      if (static_cast<double>(axis.values.size()) > 1 / length) list.push_back({.length = length});
    return list;
  };
  f.says = [](const Shape&, const Course& c) {
    return Described{"the " + c.what + " follows a smooth function of " + c.coordinate + ": from " +
                         rounded(c.least * c.scale, 3) + c.unit + " at " + rounded(c.least_at, 4) +
                         c.unit_of_coordinate + " to " + rounded(c.most * c.scale, 3) + c.unit + " at " +
                         rounded(c.most_at, 4) + c.unit_of_coordinate,
                     c.low, c.high};
  };
  return f;
}

}  // namespace fit::explain::forms
