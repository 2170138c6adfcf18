// SPDX-License-Identifier: MIT
#include "fit/beam_sector.hpp"

namespace fit::mechanisms {

// A scratch or a smear on window or mirror scatters part of the pulse: more noise of some beams, at all
// times, and no echo is lost for it. Its ends are soft or sharp.
Mechanism make_local_noise() {
  Mechanism m;
  m.id = "local-noise";
  m.cause = "some beams are noisier than others, at all times";
  m.observable = Observable::range_variance;
  m.coordinate = Coordinate::beam;
  m.formula_error = 0.25;
  m.parameters = {{.name = "sigma_mm", .typical = 6, .sign = 1},
                  centre_of_sector(),
                  width_of_sector(),
                  ends_of_sector("exponent")};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.variance_mm2 = p[0] * p[0] * share_of_sector(widths_from_centre(c, p[1], p[2]), p[3])};
  };
  m.looks_like = {"sunlight"};  // that neither comes and goes nor drowns an echo
  m.shows = [](const Finding& f, const Recorded&) { return std::vector<Interval>{sector_of(f, 1.2)}; };
  m.says = [](const Finding& f) {
    return "Around " + with_uncertainty(f.at("centre_deg"), "deg") + " (within " +
           rounded(f.at("width_deg").value, 2) + " deg) the range scatters by " +
           with_uncertainty(f.at("sigma_mm"), "mm") + " more, at all times.";
  };
  m.separate = "turn the stage and see whether the noise stays with the beam; close the blinds";
  return m;
}

}  // namespace fit::mechanisms
