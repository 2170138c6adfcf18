// SPDX-License-Identifier: MIT
#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// White Gaussian noise of the range, beyond what the bench file states.
Mechanism make_range_noise() {
  Mechanism m;
  m.id = "range-noise";
  m.corrects_a_statement = true;
  m.cause = "the range is noisier than the bench file says";
  m.observable = Observable::range_variance;
  m.coordinate = Coordinate::range;
  m.parameters = {{.name = "sigma_mm", .typical = 5, .sign = 1}};
  m.act = [](const Circumstances&, std::span<const double> p) { return Effect{.variance_mm2 = p[0] * p[0]}; };
  m.says = [](const Finding& f) {
    return "The range scatters by " + with_uncertainty(f.at("sigma_mm"), "mm") + ", the same everywhere.";
  };
  m.separate = "record a wall square on for longer";
  return m;
}

}  // namespace fit::mechanisms
