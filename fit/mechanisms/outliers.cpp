// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A fraction of the samples has nothing to do with the target: dust, other lidars, ghosts. For each of them,
// some come to nothing at all. Dust is met on the way: the more, the longer that is.
Mechanism make_outliers() {
  Mechanism m;
  m.id = "outliers";
  m.cause = "some samples have nothing to do with the target";
  m.observable = Observable::range_distribution;
  m.coordinate = Coordinate::target;
  m.formula_error = 0;  // has no curve
  m.parameters = {{.name = "fraction", .typical = 0.01, .sign = 1},
                  even_shape("lost_each", 0, 0.1, 2).generalising(),
                  // the power of the range with which the fraction grows from that at 2 m
                  even_shape("with_range", 0, 1, 2).generalising()};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double share = std::min(1.0, p[0] * std::pow(c.range_mm / 2000, p[2]));
    return Effect{.lost = share * p[1], .stray = share};
  };
  m.says = [](const Finding& f) {
    return with_uncertainty({100 * f.at("fraction").value, 100 * f.at("fraction").u}, "%") +
           " of the samples at 2 m lie far from any target" +
           (f.parameters.contains("with_range") && f.at("with_range").value > 0.5 ? ", more from farther away"
                                                                                  : "") +
           ": dust, a ghost or another lidar.";
  };
  m.separate = "switch other lidars off and look at where and when the strays come";
  return m;
}

}  // namespace fit::mechanisms
