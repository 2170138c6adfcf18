// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/causal/pulse.hpp"
#include "sim/world.hpp"

namespace sim::causal {

/// What a target is made of.
struct Material {
  double reflectance = 0.5;
  double plumb_tan = 0;
  double gloss = 0, specular = 0, specular_width = 0.05;
  std::vector<TargetTruth::Stripe> stripes;
  Pulse pulse;  ///< Shape of its echo.
};

/// A flat piece of a target.
struct Surface {
  Eigen::Vector2d from, along, normal;
  double length = 0;
  double offset = 0;    ///< normal . from
  double start_mm = 0;  ///< FilePosition of `from` on the whole target, from its middle.
  std::size_t material = 0;
};

/// Where a ray ends.
struct Hit {
  int surface = -1;
  double range = 1e30;
};

/// The targets as they stand: moved, tilted, bent or round (in flat pieces) and made of something.
class Scene {
 public:
  explicit Scene(const World& world);

  void set(const SceneState& state);
  /// Targets as they stand so long after power-on.
  void at(double since_power_on_s);
  [[nodiscard]] const std::vector<Surface>& surfaces() const { return surfaces_; }
  [[nodiscard]] const Material& material(const Surface& surface) const {
    return materials_[surface.material];
  }

  [[nodiscard]] Hit trace(const Eigen::Vector2d& origin, const Eigen::Vector2d& ray, int except = -1) const;
  /// Reflectance at a place of a surface, mm from its start.
  [[nodiscard]] double reflectance(const Surface& surface, double place) const;

 private:
  /// The pieces of a target, all of which lie within `reach_mm` of `middle`.
  struct Body {
    std::size_t first, last;
    Eigen::Vector2d middle;
    double reach_mm;
  };
  static std::vector<Eigen::Vector2d> corners_of(const fit::RoundShape& round,
                                                 const Eigen::Vector2d& outward);
  void add_pieces(const std::vector<Eigen::Vector2d>& corners, double start_mm, std::size_t material);
  void build();

  World world_;
  std::vector<Surface> surfaces_;
  std::vector<Body> bodies_;
  std::vector<Material> materials_;
  std::vector<double> shift_, reflectance_;
  std::vector<bool> moved_;
};

}  // namespace sim::causal
