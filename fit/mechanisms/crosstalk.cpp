// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Stray light of bright neighbours is part of the same echo (Pesci & Teza, IJRS 2008).
Mechanism make_crosstalk() {
  Mechanism m;
  m.id = "crosstalk";
  m.cause = "stray light of a bright neighbouring surface pulls weak echoes towards it";
  m.coordinate = Coordinate::beam;
  m.geometric = true;
  m.formula_error = 0.25;
  m.parameters = {{.name = "leak", .typical = 0.02, .sign = 1}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = p[0] * c.pull_mm};
  };
  m.says = [](const Finding& f) {
    return "Dark surfaces beside bright ones are pulled towards them, by up to " +
           rounded(std::abs(f.largest_mm), 2) +
           " mm: " + with_uncertainty({100 * f.at("leak").value, 100 * f.at("leak").u}, "%") +
           " of the neighbours' light leaks in.";
  };
  m.separate = "cover the bright surface";
  return m;
}

}  // namespace fit::mechanisms
