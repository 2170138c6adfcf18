// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/motion/steering.hpp"

namespace fit::steerings {

/// A piece: how far the left and the right wheel turned, rad. Gains: J21 and J22 of Censi et al. (2013).
Steering make_differential() {
  Steering s;
  s.id = "differential";
  s.title = "two driven wheels side by side";
  s.measures = "turn of the left wheel, turn of the right wheel (rad)";
  s.parameters = {{{"left_radius_mm", "Left wheel's radius", "mm"},
                   {"right_radius_mm", "Right wheel's radius", "mm"},
                   {"separation_mm", "Wheel separation", "mm"}}};
  s.use =
      "The robot's frame has its origin midway between the wheels, x ahead and y to the left; angles grow "
      "counter-clockwise, seen from above. A point p in the lidar's frame (x along its beam at 0 deg) is at "
      "R(yaw) p + (x, y) on the robot. Wheels that turn by a_left and a_right (rad, positive ahead) drive "
      "the "
      "robot by (r_left a_left + r_right a_right) / 2 and turn it by (r_right a_right - r_left a_left) / "
      "separation.";
  s.turn_row = [](const Eigen::Vector2d& turned) { return turned; };
  s.way_row = [](const Eigen::Vector2d& turned) {
    return Eigen::Vector2d(-0.5 * turned[0], 0.5 * turned[1]);
  };
  s.part_of = [](const Eigen::Vector2d& turned, double share) { return Eigen::Vector2d(share * turned); };
  s.turned = [](const Eigen::Vector2d& turned) { return turned.cwiseAbs().maxCoeff(); };
  s.curving = [](const Eigen::Vector2d& turned) {
    const double apart = std::abs(turned[0] - turned[1]), together = std::abs(turned[0] + turned[1]);
    return apart + together > 0 ? apart / (apart + together) : 0;
  };
  s.parameters_of = [](const Eigen::Vector2d& gains, double base_mm) {
    return Eigen::Vector3d(-gains[0] * base_mm, gains[1] * base_mm, base_mm);
  };
  s.gains_of = [](const Eigen::Vector3d& p) { return Eigen::Vector2d(-p[0] / p[2], p[1] / p[2]); };
  return s;
}

}  // namespace fit::steerings
