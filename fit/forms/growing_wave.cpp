// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/explain/model/unnamed.hpp"

namespace fit::explain::forms {

// A pattern of scans that repeats and grows or fades: no mirror does that. `length`: over so many scans.
Form make_growing_wave() {
  Form f;
  f.id = "growing wave";
  f.whole_places = true;
  f.terms = [](const Shape&) { return 4; };
  f.basis = [](const Shape& s, double x, int term) {
    const double phase = 2 * pi * x / s.at;
    return (term % 2 == 0 ? std::sin(phase) : std::cos(phase)) * (term < 2 ? 1 : x / s.length);
  };
  f.along = [](const Axis& axis) {
    std::vector<Shape> list;
    if (axis.coordinate != Coordinate::scan_seq || axis.channel != Channel::range) return list;
    for (int period = 2; period <= 8; ++period)
      list.push_back({.at = static_cast<double>(period), .length = axis.high - axis.low});
    return list;
  };
  f.says = [](const Shape& s, const Course& c) {
    return Described{
        "the " + c.what + " is the same every " + rounded(s.at, 2) + " scans, and more and more so", c.low,
        c.high};
  };
  return f;
}

}  // namespace fit::explain::forms
