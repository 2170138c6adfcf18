// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fit/mechanism.hpp"
#include "sim/engine.hpp"

namespace sim {

/// The bench's targets as they stand now, and what a beam meets there: the circumstances that the mechanisms
/// of fit/ ask for.
class ModelScene {
 public:
  explicit ModelScene(const fit::Bench& bench);

  /// Moves or recolours a target, from now on.
  void set(const SceneState& state);

  struct Hit {
    int target = -1;
    double range_mm = 0;
  };
  /// Range of a target's plane, wherever the target ends; 0 when the beam does not come near it.
  [[nodiscard]] double plane_mm(int target, const Eigen::Vector2d& origin, double bearing) const;
  [[nodiscard]] Hit cast(const Eigen::Vector2d& origin, double bearing_rad) const;

  /// A place where a nearer surface ends before a farther one.
  struct Edge {
    double bearing_rad = 0;
    double near_mm = 0, far_mm = 0;  ///< far 0: nothing behind.
    int near_side = 1;               ///< +1: the nearer surface lies at larger bearings.
    int near_target = -1, far_target = -1;
  };
  [[nodiscard]] std::vector<Edge> edges(const Eigen::Vector2d& origin) const;
  [[nodiscard]] const Edge* nearest_edge(const std::vector<Edge>& edges, double bearing_rad) const;

  /// Everything that follows from the place: range, incidence, target, corner, edge, neighbours. `hit` must
  /// have a target.
  [[nodiscard]] fit::Circumstances describe(const Eigen::Vector2d& origin, double bearing_rad, const Hit& hit,
                                            const std::vector<Edge>& edges) const;
  [[nodiscard]] double reflectance(int target) const;
  [[nodiscard]] double cos_incidence(int target, double bearing_rad) const;

 private:
  struct Wall {
    Eigen::Vector2d from, to, along, outward;
    double length = 0, reflectance = 0;
    bool joined_from = false, joined_to = false;
  };
  void build();
  static void join(Wall& one, Wall& other);
  [[nodiscard]] double power(const Hit& hit, double bearing_rad) const;
  [[nodiscard]] double pull(const Eigen::Vector2d& origin, double bearing_rad, const Hit& own) const;

  fit::Bench bench_;
  std::vector<double> shift_, reflectance_;
  std::vector<Wall> walls_;
};

}  // namespace sim
