// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A fraction of the samples has nothing to do with the target: dust, other lidars, ghosts.
Mechanism make_outliers() {
  Mechanism m;
  m.id = "outliers";
  m.cause = "some samples have nothing to do with the target";
  m.observable = Observable::range_distribution;
  m.coordinate = Coordinate::target;
  m.parameters = {{.name = "fraction", .typical = 0.01, .sign = 1}};
  m.act = [](const Circumstances&, std::span<const double> p) { return Effect{.stray = p[0]}; };
  m.says = [](const Finding& f) {
    return with_uncertainty({100 * f.at("fraction").value, 100 * f.at("fraction").u}, "%") +
           " of the samples lie far from any target: dust, a ghost or another lidar.";
  };
  m.separate = "switch other lidars off and look at where and when the strays come";
  return m;
}

}  // namespace fit::mechanisms
