// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include "sim/world.hpp"

namespace sim::causal {

/// Between the angle at which the stage's drive stands and where its table really is.
class Turntable {
 public:
  explicit Turntable(const World::Stage& settings) : settings_(settings) {}

  /// Tells where the drive stands. Gear play keeps the moves that it learnt of: others did not happen.
  void drive(double time_s, double angle_rad, double rate_rad_s);

  /// Angle of the table for a drive angle at that time.
  [[nodiscard]] double table_rad(double time_s, double angle_rad) const;
  /// Where the axis is, in the world.
  [[nodiscard]] Eigen::Vector2d axis_mm(double table_rad) const;
  /// Sine of the elevation that wobble adds to a beam at `bearing` (world).
  [[nodiscard]] double rise(double table_rad, double bearing) const;

 private:
  World::Stage settings_;
  double lag_ = 0;  ///< Wheel minus drive, within the play.
  double last_angle_ = 0, last_rate_ = 0;
  double stopped_s_ = -1e12, direction_ = 0;
  bool started_ = false;
};

}  // namespace sim::causal
