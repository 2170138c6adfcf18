// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/explain/model/unnamed.hpp"

namespace fit::explain::forms {

// A bell at one place; `length` is its standard width, file unit of the coordinate.
Form make_bump() {
  Form f;
  f.id = "bump";
  f.basis = [](const Shape& s, double x, int) { return std::exp(-0.5 * std::pow((x - s.at) / s.length, 2)); };
  f.along = [](const Axis& axis) {
    std::vector<Shape> list;
    const bool sampled_finely = axis.coordinate == Coordinate::beam || axis.coordinate == Coordinate::range ||
                                axis.coordinate == Coordinate::time || axis.coordinate == Coordinate::target;
    const bool of_an_angle = axis.channel == Channel::beam_angle || axis.channel == Channel::stage_angle;
    if (of_an_angle || !sampled_finely) return list;
    const double span = axis.high - axis.low;
    const double between_rows =
        axis.values.size() > 1 ? 1.0 / static_cast<double>(axis.values.size() - 1) : 1;
    for (const double share : {0.012, 0.024, 0.048}) {
      if (share < between_rows / 2) continue;  // narrower than rows can show
      for (double at = axis.low; at < axis.high; at += 1.5 * share * span)
        list.push_back({.at = at, .length = share * span});
    }
    return list;
  };
  f.says = [](const Shape& s, const Course& c) {
    const double reach = 1.2 * s.length, width_at_half = 2.355 * s.length;
    return Described{"the " + c.what + " has a bump of " + c.in_words(s.coefficient(0)) + " at " +
                         c.coordinate + " = " + rounded(s.at, 4) + c.unit_of_coordinate + ", " +
                         rounded(width_at_half, 2) + c.unit_of_coordinate + " wide at half its height",
                     std::max(c.low, s.at - reach), std::min(c.high, s.at + reach)};
  };
  return f;
}

}  // namespace fit::explain::forms
