// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/explain/model/unnamed.hpp"

namespace fit::explain::forms {

// Another value for a while, or in a sector: what begins and ends. From `at`, for `length`.
Form make_span() {
  Form f;
  f.id = "span";
  f.basis = [](const Shape& s, double x, int) { return x > s.at && x < s.at + s.length ? 1.0 : 0.0; };
  f.along = [](const Axis& axis) {
    std::vector<Shape> list;
    if (axis.coordinate != Coordinate::time && axis.coordinate != Coordinate::beam) return list;
    const std::size_t most = axis.coordinate == Coordinate::time ? 24 : 16;
    std::vector<double> borders;
    const std::size_t step = std::max<std::size_t>(1, (axis.between.size() + most - 1) / most);
    for (std::size_t i = 0; i < axis.between.size(); i += step) borders.push_back(axis.between[i]);
    for (std::size_t i = 0; i < borders.size(); ++i)
      for (std::size_t j = i + 1; j < borders.size(); ++j)
        list.push_back({.at = borders[i], .length = borders[j] - borders[i]});
    return list;
  };
  f.says = [](const Shape& s, const Course& c) {
    const double to = s.at + s.length;
    return Described{"the " + c.what + " changes by " + rounded(s.values.front() * c.scale, 3) + c.unit +
                         " from " + c.coordinate + " = " + rounded(s.at, 4) + " to " + rounded(to, 4) +
                         c.unit_of_coordinate,
                     s.at, to};
  };
  return f;
}

}  // namespace fit::explain::forms
