// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "sim/world.hpp"

namespace sim::causal {

/// Mirror, motor and code disk: where a beam really goes when the device believes in its nominal angle.
///
/// A disk whose centre is off the axis reads the angle as seen from that centre (exact triangle, not its
/// first harmonic; 412.5 e[um]/D[mm] arc seconds at most: Celera Motion's note on rotary encoders); one that
/// leans on its axis is read in projection, like a cardan joint.
class Rotor {
 public:
  Rotor(const World::Rotor& settings, const fit::LidarGeometry& lidar);

  struct Direction {
    double angle = 0;  ///< In the plan, rad.
    double rise = 0;   ///< Sine of the elevation.
  };
  [[nodiscard]] const Direction& direction(std::size_t step) const { return directions_[step]; }

  /// Fills the table for one face; cheap when the mirror has one.
  void turn(std::size_t scan);
  [[nodiscard]] double facet_mm() const { return facet_mm_; }

 private:
  [[nodiscard]] Direction trace(double nominal, double facet_rad) const;

  World::Rotor settings_;
  fit::LidarGeometry lidar_;
  std::vector<std::vector<Direction>> faces_;
  std::vector<Direction> directions_;
  double facet_mm_ = 0;
  std::size_t face_ = 0;
};

}  // namespace sim::causal
