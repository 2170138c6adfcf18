// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A fraction of the samples has nothing to do with the target: dust, other lidars, ghosts. For each of them, some come to
// nothing at all.
Mechanism make_outliers() {
  Mechanism m;
  m.id = "outliers";
  m.cause = "some samples have nothing to do with the target";
  m.observable = Observable::range_distribution;
  m.coordinate = Coordinate::target;
  m.formula_error = 0;  // has no curve
  m.parameters = {{.name = "fraction", .typical = 0.01, .sign = 1},
                  {.name = "lost_each",
                   .role = Parameter::Role::shape,
                   .lower = 0,
                   .upper = 0.1,
                   .starts = 2,
                   .logarithmic = false}};
  m.act = [](const Circumstances&, std::span<const double> p) { return Effect{.lost = p[0] * p[1], .stray = p[0]}; };
  m.says = [](const Finding& f) {
    return with_uncertainty({100 * f.at("fraction").value, 100 * f.at("fraction").u}, "%") +
           " of the samples lie far from any target: dust, a ghost or another lidar.";
  };
  m.separate = "switch other lidars off and look at where and when the strays come";
  return m;
}

}  // namespace fit::mechanisms
