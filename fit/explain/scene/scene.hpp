// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <set>
#include <vector>

#include "fit/bench/scene.hpp"
#include "fit/known_mechanisms.hpp"
#include "fit/mechanism.hpp"
#include "fit/recording.hpp"

namespace fit::explain {

struct Nuisance;

/// One of the numbers that say where things stand.
struct Freedom {
  const char* in_words;
  bool is_angle;
  double u;                    ///< As the bench file states it.
  double Nuisance::*of_mount;  ///< Null: of a target.
  int target = -1;             ///< -1: of the mount.
  double Displacement::*of_target = {};
  double Hit::*per = {};  ///< Of a target: d range / d it.
};
/// Mount x, y, yaw; then for every target in its order: of a flat one its offset along the outward normal and
/// its turn about its middle; of a round one its offset outward, aside (counter-clockwise), and its radius.
[[nodiscard]] std::vector<Freedom> freedoms_of(const Bench& bench);

/// Where things stand against the bench file: what is fitted along with every suspect. Millimetres and
/// radians, counter-clockwise. The mount as it is, all else as a deviation.
struct Nuisance {
  double x_mm = 0, y_mm = 0, yaw_rad = 0;
  std::vector<Displacement> targets;

  explicit Nuisance(const Bench& bench);
  /// In the order of `freedoms_of`.
  [[nodiscard]] Eigen::VectorXd as_vector() const;
  void set(const Eigen::VectorXd& values);
  [[nodiscard]] static Eigen::VectorXd prior_sigma(const Bench& bench);

 private:
  [[nodiscard]] double& value(const Freedom& freedom);
  std::vector<Freedom> freedoms_;
};

/// What all of them together do there; those of one target only to that target, and those that move it not at
/// all: the scene shows it where they put it.
[[nodiscard]] Effect effect_of(const std::vector<Active>& at_work, const Circumstances& at);

/// Reflectance of a target in a capture: what the capture states about it, or the bench file, or a middling
/// one.
[[nodiscard]] double reflectance_in(const CaptureInfo& capture, const Target& target);

/// What one beam meets in one stage position.
struct Sight : Hit {
  double bearing_rad = 0;
  Eigen::Vector2d origin = Eigen::Vector2d::Zero();
  double beam_sensitivity_mm = 0;   ///< d range / d beam angle, mm per rad.
  double stage_sensitivity_mm = 0;  ///< d range / d stage angle, mm per rad: the optical centre travels too.

  [[nodiscard]] double cos_incidence() const { return cosine; }
  [[nodiscard]] double beam_sensitivity() const { return beam_sensitivity_mm; }
  [[nodiscard]] double stage_sensitivity() const { return stage_sensitivity_mm; }
  /// d range / d one of the numbers that say where things stand; 0 for those of other targets.
  [[nodiscard]] double per(const Freedom& freedom, double stage_rad) const;
  /// Change of the measured range that an effect makes to first order, mm.
  [[nodiscard]] double shift(const Effect& effect) const;
};

/// Indices of the bench's targets that do not stand there in a capture.
using Absent = std::set<int>;

/// The targets as they stand in one capture, seen by a lidar on its stage.
class Scene : public fit::Scene {
 public:
  Scene(const Bench& bench, const Nuisance& nuisance, const CaptureInfo& capture, const Absent& absent = {});

  /// What the beam meets from the stage angle, other angles and places taken from `effect`.
  [[nodiscard]] Sight look(double stage_rad, double beam_rad, const Effect& effect = {}) const;
  /// The same for the surface of one target, whatever stands before it and wherever it ends.
  [[nodiscard]] Sight look_at(int target, double stage_rad, double beam_rad, const Effect& effect) const;
  /// The edges in sight from there, the optical centre's place taken from `effect` as well.
  [[nodiscard]] std::vector<Edge> edges(double stage_rad, const Effect& effect = {}) const;
  /// Fills what depends on the place only: range, incidence, target, edge, corner, neighbours.
  void describe(const Sight& sight, const std::vector<Edge>& edges, Circumstances& c) const;

 private:
  [[nodiscard]] Sight aim(double stage_rad, double beam_rad, const Effect& effect) const;

  double x_mm_, y_mm_, yaw_rad_;
};

}  // namespace fit::explain
