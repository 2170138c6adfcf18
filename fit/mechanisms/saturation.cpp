// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// The receiver clips, the trigger moves (Pesci & Teza, IJRS 2008): a kink at the top of the intensity axis.
// Where the counts clip as well they near a ceiling while the trigger moves on: by -ln of what is left below
// it. Where the pulse is as steep as it gets the trigger moves no further: it levels off.
Mechanism make_saturation() {
  Mechanism m;
  m.id = "saturation";
  m.cause = "bright echoes clip in the receiver and trigger early";
  m.coordinate = Coordinate::intensity;
  m.formula_error = 0.3;
  m.parameters = {{.name = "slope_mm_per_100_counts", .typical = 4},
                  log_shape("threshold_counts", 200, 3500, 16),
                  // from there to the ceiling
                  log_shape("room_counts", 20, 100'000, 14).expecting(100'000),
                  // over which it levels off
                  log_shape("level_counts", 60, 100'000, 3).generalising(100'000)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    constexpr double width = 60;  // counts over which clipping sets in
    const double over = (c.intensity - p[1]) / width;
    const double above = width * (over > 30 ? over : std::log1p(std::exp(over))),
                 left = std::max(1.0, p[2] - above),  // counts are whole, and none is beyond the ceiling
        beyond = std::max(0.0, above - (p[2] - 1)),
                 strength = p[2] * (std::log(p[2] / left) + beyond);  // counts, had none clipped
    return Effect{.range_mm =
                      std::isfinite(c.intensity) ? p[0] / 100 * p[3] * std::expm1(-strength / p[3]) : 0};
  };
  m.says = [](const Finding& f) {
    return "Echoes above " + rounded(f.at("threshold_counts").value, 3) + " counts read " +
           std::string(f.at("slope_mm_per_100_counts").value > 0 ? "short" : "long") + " by " +
           with_uncertainty(
               {std::abs(f.at("slope_mm_per_100_counts").value), f.at("slope_mm_per_100_counts").u}, "mm") +
           " for every 100 counts more: the receiver is saturated.";
  };
  m.separate = "put a grey filter over the bright target: only saturation goes away";
  return m;
}

}  // namespace fit::mechanisms
