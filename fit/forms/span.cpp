// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/explain/model/unnamed.hpp"

namespace fit::explain::forms {

// Another value for a while, in a sector, or on a piece of a target: what begins and ends. From `at` to
// `length`.
Form make_span() {
  Form f;
  f.id = "span";
  f.from_to = true;
  f.basis = [](const Shape& s, double x, int) { return x > s.at && x < s.length ? 1.0 : 0.0; };
  f.along = [](const Axis& axis) {
    std::vector<Shape> list;
    const bool of_pieces = axis.coordinate == Coordinate::beam || axis.coordinate == Coordinate::target;
    if (axis.coordinate != Coordinate::time && !of_pieces) return list;
    const std::size_t most = of_pieces ? 16 : 24;
    std::vector<double> borders;
    const std::size_t step = std::max<std::size_t>(1, (axis.between.size() + most - 1) / most);
    for (std::size_t i = 0; i < axis.between.size(); i += step) borders.push_back(axis.between[i]);
    for (std::size_t i = 0; i < borders.size(); ++i)
      for (std::size_t j = i + 1; j < borders.size(); ++j)
        list.push_back({.at = borders[i], .length = borders[j]});
    return list;
  };
  f.says = [](const Shape& s, const Course& c) {
    if (c.what == in_words_of(Channel::place).what && !c.target.empty()) {
      const Estimate out = s.coefficient(0);
      return Described{"a piece of target '" + c.target + "', from " + rounded(s.at, 4) + " to " +
                           rounded(s.length, 4) + c.unit_of_coordinate + " from its middle, lies " +
                           c.in_words({std::abs(out.value), out.u}) +
                           (out.value < 0 ? " nearer" : " farther") + " than the rest of it",
                       s.at, s.length};
    }
    return Described{"the " + c.what + " changes by " + c.in_words(s.coefficient(0)) + " from " +
                         c.coordinate + " = " + rounded(s.at, 4) + " to " + rounded(s.length, 4) +
                         c.unit_of_coordinate,
                     s.at, s.length};
  };
  return f;
}

}  // namespace fit::explain::forms
