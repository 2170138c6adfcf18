// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <set>
#include <vector>

#include "fit/mechanism.hpp"
#include "fit/recording.hpp"

namespace fit::explain {

/// Where things stand against the bench file: what is fitted along with every suspect. In the order of
/// `as_vector`: mount x, y (mm), yaw (rad), then for every target its offset along the outward normal (mm)
/// and its rotation about its middle (rad, counter-clockwise).
struct Nuisance {
  double x_mm = 0, y_mm = 0, yaw_rad = 0;
  std::vector<double> offset_mm, turn_rad;

  explicit Nuisance(const Bench& bench);
  [[nodiscard]] Eigen::VectorXd as_vector() const;
  void set(const Eigen::VectorXd& values);
  [[nodiscard]] static Eigen::VectorXd prior_sigma(const Bench& bench);
};

/// A mechanism at work, with its values in the order of its parameters.
struct Active {
  const Mechanism* mechanism = nullptr;
  std::vector<double> values;
  int target = -1;  ///< The only target it acts on; -1: all.
};

/// What all of them together do there; those of one target only to that target, and those that move it not at
/// all: the scene shows it where they put it.
[[nodiscard]] Effect effect_of(const std::vector<Active>& at_work, const Circumstances& at);

/// Reflectance of a target in a capture: what the capture states about it, or the bench file, or a middling
/// one.
[[nodiscard]] double reflectance_in(const CaptureInfo& capture, const Target& target);

/// What one beam meets in one stage position.
struct Sight {
  int target = -1;  ///< -1: nothing.
  double range_mm = 0;
  double along_mm = 0;
  int along_sign = 1;        ///< +1: along_mm grows with the beam angle; -1: against it.
  double incidence_rad = 0;  ///< Positive where the range grows with the beam angle.
  double bearing_rad = 0;
  Eigen::Vector2d origin = Eigen::Vector2d::Zero(), normal = Eigen::Vector2d::UnitX();
  double turn_lever = 0;  ///< d range / d turn of the target, mm per rad.

  double cosine = 1;          ///< Of the incidence, not below 0.02.
  double beam_lever_mm = 0;   ///< d range / d beam angle, mm per rad.
  double stage_lever_mm = 0;  ///< d range / d stage angle, mm per rad: the optical centre travels too.

  [[nodiscard]] double cos_incidence() const { return cosine; }
  [[nodiscard]] double beam_lever() const { return beam_lever_mm; }
  [[nodiscard]] double stage_lever() const { return stage_lever_mm; }
  /// Change of the measured range that an effect makes to first order, mm.
  [[nodiscard]] double shift(const Effect& effect) const;
};

/// Power of an echo from there, in units of that of a perfect target met squarely at 1 m.
[[nodiscard]] double echo_power(const CaptureInfo& capture, const Bench& bench, const Sight& sight);

/// A place where a nearer surface ends before a farther one.
struct Edge {
  double bearing_rad = 0;
  double near_mm = 0, far_mm = 0;
  int id = 0;         ///< 2 * target + (0: its start, 1: its end).
  int near_side = 1;  ///< +1: the nearer surface lies at larger bearings.
};

/// Indices of the bench's targets that do not stand there in a capture.
using Absent = std::set<int>;

/// The targets as they stand in one capture. Targets whose ends meet form a closed outline there.
class Scene {
 public:
  Scene(const Bench& bench, const Nuisance& nuisance, const CaptureInfo& capture, const Absent& absent = {});

  /// What the beam meets from the stage angle, other angles and places taken from `effect`.
  [[nodiscard]] Sight look(double stage_rad, double beam_rad, const Effect& effect = {}) const;
  /// The same for the plane of one target, whatever stands before it and wherever it ends.
  [[nodiscard]] Sight look_at(int target, double stage_rad, double beam_rad, const Effect& effect) const;
  [[nodiscard]] std::vector<Edge> edges(double stage_rad) const;
  /// To the next inner corner along the target; infinite if there is none.
  [[nodiscard]] double to_corner_mm(const Sight& sight) const;
  /// Fills what depends on the place only: range, incidence, target, edge, corner, neighbours.
  void describe(const Sight& sight, double stage_rad, const std::vector<Edge>& edges, Circumstances& c) const;

 private:
  struct Segment {
    Eigen::Vector2d from, to, middle, along, outward;
    double half_mm, reflectance;
    int joined_from = -1, joined_to = -1;  ///< The target that its end meets; -1: none.
    double corner_from_mm, corner_to_mm;   ///< Where it meets them, along from its middle.
    double moved_mm;  ///< How far its ends are from where the bench file has them, at most.
    bool absent;
  };
  [[nodiscard]] Sight aim(double stage_rad, double beam_rad, const Effect& effect) const;
  /// Fills in where the beam meets that segment's plane; false if it does not.
  [[nodiscard]] bool meet(std::size_t segment, Sight& sight) const;
  /// How far past a corner with that target, -1: none, a segment may be met.
  [[nodiscard]] double reach_past_mm(int joined) const;
  /// Where a segment meets the one that it is joined to, along from its middle, as both stand.
  [[nodiscard]] double corner(const Segment& own, int joined, double stated_mm) const;
  static void finish(Sight& sight);
  [[nodiscard]] double echo_power(const Sight& sight) const;
  [[nodiscard]] double pull(const Sight& sight, double stage_rad) const;

  Nuisance nuisance_;
  std::vector<Segment> segments_;
};

}  // namespace fit::explain
