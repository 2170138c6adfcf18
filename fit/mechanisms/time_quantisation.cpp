// SPDX-License-Identifier: MIT
#include <cstdint>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// Bins of the time-to-digital converter (65 ps = 9.7 mm, 10 ps = 1.5 mm): the range is rounded before noise
// is added, so that means show bins far below the noise and below the output's step. `starts` counts the bins
// that can be told apart over a few metres. The counter's zero need not be the scale's: the zero is set
// afterwards.
Mechanism make_time_quantisation() {
  Mechanism m;
  m.id = "time-quantisation";
  m.cause = "the flight time is counted in coarse bins";
  m.coordinate = Coordinate::range;
  m.formula_error = 0.1;
  m.parameters = {{.name = "share", .typical = 0.1, .expected = 1, .sign = 1},
                  log_shape("bin_mm", 0.25, 40, 80000).on(Parameter::Scale::bin),
                  // of the counter before that of the scale, in bins
                  even_shape("zero", 0, 1, 4).generalising()};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double counted = c.range_mm / p[1] + p[2],
                 bins = static_cast<double>(static_cast<std::int64_t>(counted + 0.5));
    return Effect{.range_mm = p[0] * p[1] * (bins - counted)};
  };
  m.says = [](const Finding& f) {
    return "Distances come in bins of " + with_uncertainty(f.at("bin_mm"), "mm") +
           ": the flight time is counted coarsely.";
  };
  m.separate = "look along a slanted wall, where the range changes slowly from beam to beam";
  return m;
}

}  // namespace fit::mechanisms
