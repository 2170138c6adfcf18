// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <string>
#include <vector>

namespace fit {

/// How a robot's wheels move it. Each lives in its own file steerings/NAME.cpp, which defines
/// `fit::Steering fit::steerings::make_NAME()`; the build finds it by its name.
///
/// A piece of motion is two numbers; what they are is the steering's own matter (`measures`). The robot's
/// turn over a piece is `turn_row(piece) . gains`, its way `base * way_row(piece) . gains`: linear in two
/// gains, so that these follow from headings alone and all lengths are proportional to the base.
struct Steering {
  struct Parameter {
    std::string name, label, unit;
    double scale = 1;  ///< From the inside unit (mm, rad).
  };
  std::string id, title, measures;
  std::array<Parameter, 3> parameters;  ///< The last is the base.
  std::string use;                      ///< How to drive by them, in words.

  std::function<Eigen::Vector2d(const Eigen::Vector2d&piece)> turn_row, way_row;
  /// The first `share` of a piece.
  std::function<Eigen::Vector2d(const Eigen::Vector2d& piece, double share)> part_of;
  /// How much a wheel turned (rad), and how tight the curve was: 0 straight, 1 on the spot.
  std::function<double(const Eigen::Vector2d&piece)> turned, curving;
  std::function<Eigen::Vector3d(const Eigen::Vector2d& gains, double base_mm)> parameters_of;
  std::function<Eigen::Vector2d(const Eigen::Vector3d& parameters)> gains_of;
};

/// All steerings, in alphabetical order of their files.
[[nodiscard]] const std::vector<Steering>& all_steerings();
/// Null when there is none of that name.
[[nodiscard]] const Steering* find_steering(const std::string& id);
/// Two driven wheels, side by side.
[[nodiscard]] const Steering& differential();
/// Null means two driven wheels.
[[nodiscard]] inline const Steering& steering_of(const Steering* given) {
  return given ? *given : differential();
}

}  // namespace fit
