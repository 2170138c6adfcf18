// SPDX-License-Identifier: MIT
#include "fit/on_stage.hpp"

namespace fit::mechanisms {

// Optical centre off the stage's axis: origin R(theta) (x, y). Same as the bench's mount, told only by its
// prior.
Mechanism make_lidar_arm() {
  Mechanism m;
  m.id = "lidar-arm";
  m.cause = "the optical centre sits farther off the stage's axis than the bench file says";
  m.coordinate = Coordinate::stage;
  m.geometric = true;
  m.formula_error = 0.01;
  m.parameters = {{.name = "x_mm", .typical = 15}, {.name = "y_mm", .typical = 15}};
  m.act = [](const Circumstances& c, std::span<const double> p) {
    return Effect{.origin_mm = on_stage_mm(c, p[0], p[1])};
  };
  m.looks_like = {"stage-eccentricity", mount_offset};
  m.says = [](const Finding& f) {
    return "The optical centre sits " + with_uncertainty(f.at("x_mm"), "mm") + " / " +
           with_uncertainty(f.at("y_mm"), "mm") +
           " (x / y) beyond where the bench file puts it. This is seen only against the bench file's own "
           "uncertainty: the file is wrong or the arm is long.";
  };
  m.separate = "look at one target with different beams: turn the stage, keep the target";
  return m;
}

}  // namespace fit::mechanisms
