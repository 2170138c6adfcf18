// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <optional>
#include <vector>

#include "fit/bench/bench.hpp"
#include "fit/mechanism.hpp"

namespace fit {

/// How one target of a bench stands at the moment, against what the bench file states.
struct Stands : Displacement {
  std::optional<double> reflectance;  ///< Another than the bench file's.
  bool moved = false;                 ///< Put elsewhere on purpose: it forms no corner with others any more.
  bool absent = false;                ///< Not there at all.
};

/// Where a ray meets a target.
struct Hit {
  int target = -1;  ///< -1: nothing.
  double range_mm = 0;
  double along_mm = 0;       ///< From the target's middle towards its end; of a round one along its surface.
  int along_sign = 1;        ///< +1: along_mm grows with the beam angle; -1: against it.
  double incidence_rad = 0;  ///< Positive where the range grows with the beam angle.
  double cosine = 1;         ///< Of the incidence, not below 0.02.
  Eigen::Vector2d normal = Eigen::Vector2d::UnitX();  ///< Unit normal of the surface, away from the viewer.
  /// d range / d of what `Stands` says of the target (mm per mm, turn: mm per rad).
  double per_out = 0, per_aside = 0, per_turn = 0, per_thicker = 0;
};

/// A place where a nearer surface ends before a farther one, or before nothing.
struct Edge {
  double bearing_rad = 0;
  double near_mm = 0, far_mm = 0;  ///< far 0: nothing behind.
  int id = 0;         ///< 2 * target + (0: its start, or the right side of a round one; 1: the other).
  int near_side = 1;  ///< +1: the nearer surface lies at larger bearings.
  int near_target = -1, far_target = -1;
};

/// The targets of a bench seen from above: flat ones, whose ends meet in corners or stand free, and round
/// ones. Corners are where the lines of two targets cross whose stated ends lie there: as long as they do, a
/// target that is moved or turned leaves no gap and no overhang.
class Scene {
 public:
  /// `stands`: one for every target of the bench, or none: all as stated.
  explicit Scene(const Bench& bench, const std::vector<Stands>& stands = {});

  /// What a ray from there meets first.
  [[nodiscard]] Hit look(const Eigen::Vector2d& origin_mm, double bearing_rad) const;
  /// The same for one target, whatever stands before it and wherever it ends; a round one that the ray passes
  /// is met where it comes nearest.
  [[nodiscard]] Hit look_at(int target, const Eigen::Vector2d& origin_mm, double bearing_rad) const;
  /// Edges in sight of that place.
  [[nodiscard]] std::vector<Edge> edges(const Eigen::Vector2d& origin_mm) const;
  /// From there along the target to the next inner corner; infinite if there is none.
  [[nodiscard]] double to_corner_mm(const Hit& hit) const;
  /// ... to the next place where another target begins, inner corner or outer.
  [[nodiscard]] double to_joint_mm(const Hit& hit) const;
  /// Fills what depends on the place and its own surface only: range, incidence, corner.
  void describe_place(double bearing_rad, const Hit& hit, Circumstances& c) const;
  /// The same, and what target, edge and neighbours are.
  void describe(const Eigen::Vector2d& origin_mm, double bearing_rad, const Hit& hit,
                const std::vector<Edge>& edges, Circumstances& c) const;
  [[nodiscard]] double reflectance(int target) const { return of(target).reflectance; }
  /// Of a round one a quarter of its circumference.
  [[nodiscard]] double half_length_mm(int target) const { return of(target).half_mm; }

 private:
  /// Where another target begins on a flat one.
  struct Joint {
    int other;
    double at_mm;          ///< Along from the middle.
    Eigen::Vector2d away;  ///< Direction in which the other one goes on from there; zero: in both.
  };
  struct Surface {
    Eigen::Vector2d middle, along, outward;
    double from_mm = 0, to_mm = 0;  ///< Its ends, along from its middle.
    double half_mm = 0;             ///< As stated.
    double radius_mm = 0;           ///< Round: > 0.
    double reflectance = 0.5;
    bool absent = false;
    std::vector<Joint> joints;

    [[nodiscard]] bool is_round() const { return radius_mm > 0; }
  };
  [[nodiscard]] const Surface& of(int target) const { return surfaces_[static_cast<std::size_t>(target)]; }
  void join(const Bench& bench, const std::vector<Stands>& stands);
  /// Whether the other begins where that one has that place, along from its middle.
  [[nodiscard]] bool begins_there(int other, int one, double at_mm) const;
  /// Range, and along a flat one the place, where a ray meets it; `anyway`: beyond its ends too.
  [[nodiscard]] static bool crosses(const Surface& s, const Eigen::Vector2d& origin,
                                    const Eigen::Vector2d& ray, bool anyway, Hit& hit);
  /// All else about it.
  static void fill_in(const Surface& s, const Eigen::Vector2d& origin, const Eigen::Vector2d& ray, Hit& hit);
  [[nodiscard]] double power(const Hit& hit) const;
  /// Whether that surface is flat and all that stray light comes from.
  [[nodiscard]] bool fills(const Hit& own, double bearing, const Edge* edge) const;
  /// A direction beside a beam, and weights of the light from there.
  struct Aside {
    double angle_rad, cos, sin;
    std::array<double, 3> weights{};
  };
  /// `weight` of an angle in units of each of three widths.
  [[nodiscard]] static std::vector<Aside> asides(double step_rad, double most_rad,
                                                 const std::array<double, 3>& widths_rad,
                                                 double (*weight)(double));
  struct Beside {
    double range_mm, light;  ///< Over that of the beam.
  };
  /// What a ray beside another one meets; `slope`: of the plane that is all it can meet.
  [[nodiscard]] std::optional<Beside> beside(const Eigen::Vector2d& origin, double bearing, const Hit& own,
                                             const Aside& aside, std::optional<double> slope) const;
  void describe_pull(const Eigen::Vector2d& origin, double bearing, const Hit& own, Circumstances& c) const;
  void describe_spread(const Eigen::Vector2d& origin, double bearing, const Hit& own, const Edge* edge,
                       Circumstances& c) const;

  std::vector<Surface> surfaces_;
};

/// The edge next to a bearing, or null.
[[nodiscard]] const Edge* nearest_edge(const std::vector<Edge>& edges, double bearing_rad);

}  // namespace fit
