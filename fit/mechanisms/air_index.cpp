// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// The firmware's refractive index is not this air's (Ciddor 1996: 2.8e-4 in all, which falls by 1e-6 per
// kelvin that the air is warmer, and by less per kelvin of the housing). Below resolution at the ranges of
// these lidars unless left out altogether.
Mechanism make_air_index() {
  Mechanism m;
  m.id = "air-index";
  m.cause = "the refractive index of the air is not the one the lidar assumes";
  m.coordinate = Coordinate::range;
  m.formula_error = 0.02;
  m.parameters = {{.name = "index_error", .typical = 1e-4, .largest = 3.2e-4},
                  {.name = "index_error_per_k", .typical = 1e-6, .largest = 1.1e-6, .sign = -1}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double warmer_k = std::isfinite(c.temperature_k) ? c.temperature_k : 0;
    return Effect{.range_mm = (p[0] + p[1] * warmer_k) * c.range_mm};
  };
  m.looks_like = {"range-scale"};  // that is small
  m.says = [](const Finding& f) {
    const auto ppm = [&](const char* name) { return Estimate{1e6 * f.at(name).value, 1e6 * f.at(name).u}; };
    return "Distances are in proportion off by " + with_uncertainty(ppm("index_error"), "ppm") + " and by " +
           with_uncertainty(ppm("index_error_per_k"), "ppm/K") +
           " of the temperature, as little as the air's refractive index can cause.";
  };
  m.separate = "repeat on a day of other temperature and pressure";
  return m;
}

}  // namespace fit::mechanisms
