// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/explain/unnamed.hpp"

namespace fit::explain::forms {

// Any smooth curve: cosines with the spectrum of a Gaussian process; `length` is its correlation length as a
// share of the span.
Form make_smooth() {
  Form f;
  f.id = "smooth";
  f.has_a_place = false;
  f.scaled = true;
  f.terms = [](const Shape& s) { return std::clamp(static_cast<int>(2.2 / s.length), 4, 30); };
  f.basis = [](const Shape&, double x, int term) { return std::cos((term + 1) * pi * (x + 1) / 2); };
  f.shares = [terms = f.terms](const Shape& s) {
    std::vector<double> list;
    double squares = 0;
    for (int j = 1; j <= terms(s); ++j) {
      list.push_back(std::exp(-0.5 * std::pow(j * pi * s.length / 2, 2)));
      squares += list.back() * list.back();
    }
    for (double& share : list) share *= std::sqrt(2 / squares);
    return list;
  };
  f.along = [](const Axis& axis) {
    std::vector<Shape> list;
    for (const double length : {0.5, 0.2, 0.08})
      if (static_cast<double>(axis.values) > 2 / length) list.push_back({.length = length});
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
