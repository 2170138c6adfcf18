// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {
namespace {

/// For a halo between those that circumstances know.
double pull_of(const std::array<double, 3>& pull_mm, double reach_deg) {
  const double last = static_cast<double>(halos_rad.size()) - 1,
               at = std::clamp(std::log2(reach_deg * rad_per_deg / halos_rad.front()), 0.0, last);
  const auto k = static_cast<std::size_t>(std::min(at, last - 1));
  return pull_mm[k] + (at - static_cast<double>(k)) * (pull_mm[k + 1] - pull_mm[k]);
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
      {.name = "reach_deg",  // where it falls to a half
       .role = Parameter::Role::shape,
       .expected = 0.7,
       .lower = 0.35,
       .upper = 1.4,
       .generalises = true,
       .starts = 5},
      {.name = "apart",  // how strongly echoes pull that come apart, as of a receiver that times light
       .role = Parameter::Role::shape,  // as a whole: in proportion to surfaces half a metre apart
       .lower = 0,
       .upper = 4,
       .generalises = true,
       .starts = 3,
       .logarithmic = false}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = p[0] * (pull_of(c.pull_mm, p[1]) + p[2] * pull_of(c.pull_apart_mm, p[1]))};
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
