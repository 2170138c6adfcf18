// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Clock or bin length of the time counter (crystals: 50 ppm; larger where the bin length is computed
// wrongly, but not by more than anybody would see with a tape).
Mechanism make_range_scale() {
  Mechanism m;
  m.id = "range-scale";
  m.cause = "the clock that counts the flight time runs fast or slow";
  m.coordinate = Coordinate::range;
  m.formula_error = 0.02;
  m.parameters = {{.name = "scale", .typical = 3e-3, .largest = 0.03}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = p[0] * c.range_mm};
  };
  m.looks_like = {"air-index"};  // which is never more than 0.03 %
  m.says = [](const Finding& f) {
    return "Distances read in proportion too " + std::string(f.at("scale").value > 0 ? "long" : "short") +
           " by " + with_uncertainty({f.at("scale").value * 1000, f.at("scale").u * 1000}, "mm per metre") +
           ".";
  };
  m.separate = "change the target's reflectance at a fixed distance: a scale does not care";
  return m;
}

}  // namespace fit::mechanisms
