// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {
namespace {

/// For a halo between those that circumstances know.
double pull_of(const std::array<double, 3>& pull_mm, double reach_deg) {
  const double reach_rad = reach_deg * rad_per_deg;
  const std::size_t k = reach_rad < halos_rad[1] ? 0 : 1;
  const double share = std::log(reach_rad / halos_rad[k]) / std::log(halos_rad[k + 1] / halos_rad[k]);
  return std::lerp(pull_mm[k], pull_mm[k + 1], std::clamp(share, 0.0, 1.0));
}

}  // namespace

// Stray light of bright neighbours is part of the same echo (Pesci & Teza, IJRS 2008).
Mechanism make_crosstalk() {
  Mechanism m;
  m.id = "crosstalk";
  m.cause = "stray light of a bright neighbouring surface pulls weak echoes towards it";
  m.coordinate = Coordinate::beam;
  m.geometric = true;
  m.formula_error = 0.25;
  // How far stray light reaches differs from receiver to receiver.
  m.parameters = {
      {.name = "leak", .typical = 0.02, .sign = 1},
      // where it falls to a half
      log_shape("reach_deg", 0.5, 1.4, 5).generalising(0.7),
      // What receivers time, from light as a whole (-1), where what comes apart pulls as well, in proportion
      // to surfaces half a metre off, to the front of the echo (1), which nearer light brings forward most.
      even_shape("timing", -1, 1, 5).generalising()};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    const double beyond =
        p[2] < 0 ? -4 * p[2] * pull_of(c.pull_apart_mm, p[1]) : p[2] * pull_of(c.pull_front_mm, p[1]);
    return Effect{.range_mm = p[0] * (pull_of(c.pull_mm, p[1]) + beyond)};
  };
  m.says = [](const Finding& f) {
    return "Dark surfaces beside bright ones are pulled towards them, by up to " +
           rounded(std::abs(f.largest_mm), 2) +
           " mm: " + with_uncertainty({100 * f.at("leak").value, 100 * f.at("leak").u}, "%") +
           " of the neighbours' light leaks in.";
  };
  m.separate = "cover the bright surface";
  m.looks_like = {"incidence-bias"};  // where halos reach no other surface
  return m;
}

}  // namespace fit::mechanisms
