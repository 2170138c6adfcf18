// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/explain/model/unnamed.hpp"
#include "fit/forms/cosines.hpp"

namespace fit::explain::forms {

// No wall is flat: every target has a smooth shape of its own, all of them by as much. `at`: the number of
// targets; `length`: correlation length as a share of each.
Form make_surfaces() {
  Form f;
  f.id = "surfaces";
  f.of_all_targets = true;
  f.terms = [](const Shape& s) { return static_cast<int>(s.at) * cosines_of(s.length); };
  f.basis = [](const Shape& s, double x, int term) {
    const int each = cosines_of(s.length);
    const double target = std::floor(x);
    return static_cast<int>(target) == term / each ? cosine(2 * (x - target) - 1, term % each) : 0.0;
  };
  f.shares = [](const Shape& s) {
    std::vector<double> all;
    const std::vector<double> one = shares_of_cosines(s.length);
    for (int target = 0; target < static_cast<int>(s.at); ++target)
      all.insert(all.end(), one.begin(), one.end());
    return all;
  };
  f.along = [](const Axis& axis) {
    constexpr int most_terms = 100;
    std::vector<Shape> list;
    const double targets = std::floor(axis.high) + 1;
    for (const double length : {0.5, 0.25})
      if (targets * cosines_of(length) <= most_terms) list.push_back({.at = targets, .length = length});
    return list;
  };
  f.says = [](const Shape&, const Course& c) {
    return Described{"every target has a shape of its own: the " + c.what + " follows a smooth function of " +
                         c.coordinate + ", another one on each",
                     c.low, c.high};
  };
  return f;
}

}  // namespace fit::explain::forms
