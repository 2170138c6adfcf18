// SPDX-License-Identifier: MIT
#include <algorithm>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A target was pushed, or its stand gave way, while the session was recorded; and perhaps it was put back.
Mechanism make_target_moved() {
  Mechanism m;
  m.id = "target-moved";
  m.cause = "a target was moved while the session was recorded";
  m.coordinate = Coordinate::time;
  m.one_target = true;
  m.geometric = true;
  m.only_for_a_while = true;
  m.formula_error = 0.01;
  m.parameters = {{.name = "offset_mm", .typical = 5, .largest = 300},
                  {.name = "turn_deg", .typical = 0.5, .largest = 20, .targets = Targets::flat},
                  {.name = "aside_mm", .typical = 5, .largest = 300, .targets = Targets::round},
                  begins_at(),
                  ends_at()};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    if (c.clock_s < p[3] || c.clock_s > p[4]) return Effect{};
    const double turned_mm = c.round ? 0 : c.along_sign * c.along_mm * p[1] * rad_per_deg;
    return Effect{.range_mm = range_of_move(c, p[0] - turned_mm, p[2])};
  };
  m.looks_like = {"mount-moved", "warm-up"};  // where there is no other
  m.says = [](const Finding& f) {
    return "From " + rounded(f.at("from_s").value) + " to " + rounded(f.at("to_s").value) +
           " s after power-on target '" + f.target + "' stood elsewhere: along its normal by " +
           with_uncertainty(f.at("offset_mm"), "mm") +
           (f.parameters.contains("turn_deg") ? ", turned by " + with_uncertainty(f.at("turn_deg"), "deg")
                                              : ", aside by " + with_uncertainty(f.at("aside_mm"), "mm")) +
           ". Fasten it, and record the session again.";
  };
  m.separate = "look at the first stop again: a target that was moved is elsewhere than it was";
  return m;
}

}  // namespace fit::mechanisms
