// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/explain/model/unnamed.hpp"

namespace fit::explain::forms {

// A target that stands elsewhere every time: a curtain, a door in a draught, a board that is put back by
// hand; or all ranges, whose zero wanders from capture to capture. `places`: the times; at each, and until
// the next, there is a value of its own.
Form make_anew() {
  Form f;
  f.id = "anew";
  f.happened_then = true;
  f.terms = [](const Shape& s) { return static_cast<int>(s.places.size()); };
  f.basis = [](const Shape& s, double x, int term) {
    const auto last = std::ranges::upper_bound(s.places, x) - s.places.begin() - 1;
    return std::max<std::ptrdiff_t>(0, last) == term ? 1.0 : 0.0;
  };
  f.along = [](const Axis& axis) {
    constexpr std::size_t most_terms = 60;
    std::vector<Shape> list;
    if (axis.values.size() <= most_terms) list.push_back({.places = axis.values});
    return list;
  };
  f.says = [](const Shape& s, const Course& c) {
    double sum = 0, squares = 0;
    const auto n = static_cast<double>(s.values.size());
    for (const double value : s.values) {
      sum += value;
      squares += value * value;
    }
    const double deviation_mm = std::sqrt(std::max(0.0, squares - sum * sum / n) / (n - 1));
    return Described{
        (c.target.empty() ? "the range's zero wanders from capture to capture, by "
                          : "target '" + c.target + "' stands elsewhere from capture to capture, by ") +
            rounded(deviation_mm, 2) + " mm (standard deviation)",
        c.low, c.high};
  };
  return f;
}

}  // namespace fit::explain::forms
