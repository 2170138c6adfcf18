// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/motion/steering.hpp"
#include "fit/numeric/angle.hpp"

namespace fit::steerings {

/// One wheel in front that is driven and steered, two behind that only roll. A piece: how far the wheel
/// turned, and how far it was steered to the left meanwhile, rad. With radius r, base b and steering zero z
/// the robot turns by r/b sin(steered + z) and goes r cos(steered + z) for each radian: linear in r/b cos z
/// and r/b sin z.
Steering make_tricycle() {
  Steering s;
  s.id = "tricycle";
  s.title = "one driven and steered wheel ahead of two that roll";
  s.measures = "turn of the driven wheel, its steering angle (rad)";
  s.parameters = {{{"wheel_radius_mm", "Driven wheel's radius", "mm"},
                   {"steering_zero_deg", "Steering angle when it reads 0", "deg", deg_per_rad},
                   {"wheelbase_mm", "Steered wheel ahead of the rear axle", "mm"}}};
  s.use =
      "The robot's frame has its origin midway between the rear wheels, x ahead and y to the left; angles "
      "grow "
      "counter-clockwise, seen from above. A point p in the lidar's frame (x along its beam at 0 deg) is at "
      "R(yaw) p + (x, y) on the robot. The front wheel, turning by a (rad, positive ahead) while steered to "
      "s "
      "(positive to the left), drives the robot by r a cos(s + zero) and turns it by r a sin(s + zero) / "
      "wheelbase.";
  s.turn_row = [](const Eigen::Vector2d& p) {
    return Eigen::Vector2d(p[0] * std::sin(p[1]), p[0] * std::cos(p[1]));
  };
  s.way_row = [](const Eigen::Vector2d& p) {
    return Eigen::Vector2d(p[0] * std::cos(p[1]), -p[0] * std::sin(p[1]));
  };
  s.part_of = [](const Eigen::Vector2d& p, double share) { return Eigen::Vector2d(share * p[0], p[1]); };
  s.turned = [](const Eigen::Vector2d& p) { return std::abs(p[0]); };
  s.curving = [](const Eigen::Vector2d& p) { return std::abs(std::sin(p[1])); };
  s.parameters_of = [](const Eigen::Vector2d& gains, double base_mm) {
    return Eigen::Vector3d(base_mm * gains.norm(), std::atan2(gains[1], gains[0]), base_mm);
  };
  s.gains_of = [](const Eigen::Vector3d& p) {
    return Eigen::Vector2d(p[0] / p[2] * std::cos(p[1]), p[0] / p[2] * std::sin(p[1]));
  };
  return s;
}

}  // namespace fit::steerings
