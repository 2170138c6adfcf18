// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/mechanism.hpp"

namespace fit::mechanisms {

// A target stands elsewhere along its normal than the bench file says; a round one in any direction.
Mechanism make_target_offset() {
  Mechanism m;
  m.id = "target-offset";
  m.cause = "a target does not stand where the bench file says";
  m.coordinate = Coordinate::target;
  m.one_target = true;
  m.geometric = true;
  m.parameters = {{.name = "offset_mm", .typical = 8},
                  {.name = "aside_mm", .typical = 8, .targets = Targets::round}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.range_mm = range_of_move(c, p[0], p[1])};
  };
  m.displaces = [](std::span<const double> p) { return Displacement{.out_mm = p[0], .aside_mm = p[1]}; };
  m.looks_like = {"target-radius"};  // of a round one of which only the middle is met
  m.says = [](const Finding& f) {
    const Estimate offset = f.at("offset_mm");
    if (f.parameters.contains("aside_mm")) {
      const Estimate aside = f.at("aside_mm");
      return "The middle of target '" + f.target + "' stands " +
             with_uncertainty({std::abs(offset.value), offset.u}, "mm") +
             (offset.value > 0 ? " farther out and " : " farther in and ") +
             with_uncertainty({std::abs(aside.value), aside.u}, "mm") +
             (aside.value > 0 ? " counter-clockwise" : " clockwise") +
             " of where the bench file says, which its uncertainty does not allow.";
    }
    return "Target '" + f.target + "' stands " + with_uncertainty({std::abs(offset.value), offset.u}, "mm") +
           (offset.value > 0 ? " farther out" : " farther in") +
           " along its normal than the bench file says, which its uncertainty does not allow.";
  };
  m.separate = "move or turn the target, not the lidar";
  return m;
}

}  // namespace fit::mechanisms
