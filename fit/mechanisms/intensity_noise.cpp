// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/mechanism.hpp"
#include "fit/weakest_echo.hpp"

namespace fit::mechanisms {

// sigma^2 = s0^2 + s1^2 / I (Wujanz et al. 2018): weak echoes scatter more. The exponent is left free.
Mechanism make_intensity_noise() {
  Mechanism m;
  m.id = "intensity-noise";
  m.cause = "weak echoes scatter more";
  m.observable = Observable::range_variance;
  m.coordinate = Coordinate::intensity;
  m.parameters = {{.name = "sigma_mm_at_100_counts", .typical = 5, .sign = 1},
                  even_shape("exponent", 1, 4, 5)};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    if (!std::isfinite(c.intensity)) return Effect{};
    return Effect{.variance_mm2 = p[0] * p[0] * std::pow(100 / counts_of_echo(c.intensity), p[1])};
  };
  m.shows = [](const Finding& f, const Recorded& r) {  // down to a quarter of the largest variance
    const double top = r.from * std::pow(4.0, 1 / std::max(1.0, f.at("exponent").value));
    return std::vector<Interval>{
        {Coordinate::intensity, r.from, std::min(r.to, std::max(top, r.from + (r.to - r.from) / 30))}};
  };
  m.says = [](const Finding& f) {
    return "Weak echoes scatter more: beside the constant noise there is " +
           with_uncertainty(f.at("sigma_mm_at_100_counts"), "mm") +
           " at 100 counts, its variance growing with the power " + rounded(f.at("exponent").value, 2) +
           " of one over the intensity.";
  };
  m.separate = "change the target's reflectance at a fixed distance";
  return m;
}

}  // namespace fit::mechanisms
