// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// AR(1) between scans: of N samples only N (1 - rho) / (1 + rho) count.
Mechanism make_correlated_noise() {
  Mechanism m;
  m.id = "correlated-noise";
  m.cause = "the noise remembers the scans before";
  m.observable = Observable::time_correlation;
  m.coordinate = Coordinate::time;
  m.parameters = {even_shape("rho", 0.05, 0.98, 8),
                  {.name = "share", .typical = 0.2, .largest = 1, .sign = 1}};
  m.act = [](const Circumstances&, std::span<const double> p) {
    constexpr double most = 0.99;  // what never fades would be an offset
    return Effect{.ar1_rho = std::min(most, p[0]), .ar1_share = p[1]};
  };
  m.says = [](const Finding& f) {
    return "The noise remembers: " + rounded(100 * f.at("share").value, 2) +
           " % of its variance carries over from scan to scan with rho = " +
           with_uncertainty(f.at("rho"), "") +
           ", so averages over many scans are worth less than their number.";
  };
  m.separate = "record one parked pose for long, with the lamps off";
  return m;
}

}  // namespace fit::mechanisms
