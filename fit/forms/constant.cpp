// SPDX-License-Identifier: MIT
#include "fit/explain/model/unnamed.hpp"

namespace fit::explain::forms {

// The same everywhere, where nothing is expected at all: what every scan draws anew, a tail of the noise.
Form make_constant() {
  Form f;
  f.id = "constant";
  f.is_constant = true;
  f.basis = [](const Shape&, double, int) { return 1.0; };
  f.along = [](const Axis& axis) {
    return axis.expects_nothing ? std::vector<Shape>(1) : std::vector<Shape>();
  };
  f.says = [](const Shape& s, const Course& c) {
    return Described{"the " + c.what + " is " + c.in_words(s.coefficient(0)), c.low, c.high};
  };
  return f;
}

}  // namespace fit::explain::forms
