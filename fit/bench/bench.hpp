// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "fit/bench/bench_document.hpp"
#include "fit/numeric/angle.hpp"
#include "fit/numeric/estimate.hpp"

namespace fit {

/// Where the lidar's optical centre sits on the stage: its origin at stage angle 0 and its yaw.
struct Mount {
  Estimate x_mm{0}, y_mm{0}, yaw_rad{0};
  friend bool operator==(const Mount&, const Mount&) = default;
};

/// The lidar's scan pattern. Beam k points to `beam_angle(k)` in the lidar's frame, counter-clockwise.
struct LidarGeometry {
  std::string model = "UST-10LX";
  int steps = 1081;  ///< The device counts from 0, so that its last step is steps - 1 (AMAX).
  int front_step = 540;
  double step_rad = 0.25 * rad_per_deg;
  double scan_hz = 40;
  Mount mount;
  int first_step = 0;  ///< Steps before it measure nothing (AMIN).
  std::string serial;  ///< Of the one device that the bench is about; empty: of any.

  [[nodiscard]] double beam_angle(double step) const { return (step - front_step) * step_rad; }
  /// Seconds from the scan's time stamp (step 0 is passed) to beam k; a full turn takes 1 / scan_hz.
  [[nodiscard]] double beam_time_s(double step) const { return step * step_rad / (2 * pi * scan_hz); }
};

/// A post or a pipe seen from above.
struct RoundShape {
  Eigen::Vector2d centre_mm = Eigen::Vector2d::Zero();
  double radius_mm = 0, u_radius_mm = 0;
};

/// A target seen from above: flat, the segment from `from` to `to` in the world frame; or round. `from` and
/// `to` of a round one are the tangent before it, as wide as it is, for whoever only asks where and how wide
/// it is.
struct Target {
  std::string name;
  Eigen::Vector2d from_mm = Eigen::Vector2d::Zero(), to_mm = Eigen::Vector2d::Zero();
  double u_mm = 0;  ///< Standard uncertainty of the offset along the normal; of a round one, of its centre in
                    ///< each direction.
  double u_rad = 0;  ///< Standard uncertainty of the orientation.
  std::optional<double> reflectance;
  std::optional<RoundShape> round;

  /// Makes it round; `from_mm` and `to_mm` follow.
  void set_round(const RoundShape& shape);
  /// Unit normal that points away from the stage's axis (the direction of a capture's target_shift_mm).
  [[nodiscard]] Eigen::Vector2d outward_normal() const;
};

/// A mechanism that is already part of the simulation. Parameters carry units in their names, as in the file;
/// text parameters (a target's name, say) are kept apart.
struct KnownMechanism {
  std::string mechanism;
  std::map<std::string, Estimate> parameters;
  std::map<std::string, std::string> texts;
  friend bool operator==(const KnownMechanism&, const KnownMechanism&) = default;
};

/// What the operator knows of the set-up: the prior of every fit and the scene of the simulator
/// (`bench/1`, docs/reference/bench.md).
struct Bench {
  LidarGeometry lidar;
  double stage_resolution_rad = 0.01 * rad_per_deg;
  std::vector<Target> targets;
  std::vector<KnownMechanism> known;
  /// Where the keys of "lidar" stand, as NAME:LINE:COLUMN; "" is the object itself.
  std::map<std::string, std::string> lidar_places;
  /// The document it came from, so that a bench written back loses nothing.
  BenchDocument document;

  [[nodiscard]] const Target* target(const std::string& name) const;
  [[nodiscard]] const Target& target_at(int index) const { return targets[static_cast<std::size_t>(index)]; }
  [[nodiscard]] const KnownMechanism* knows(const std::string& mechanism) const;
};

/// Reads a bench file's text (JSON with comments). Throws std::invalid_argument whose message names the place
/// ("NAME:LINE:COLUMN" or the JSON path), what was expected and what to do. `name` is only used in messages.
Bench parse_bench(const std::string& text, const std::string& name = "bench");
/// The same of a file that someone has just written: keys that are given twice, and slips in what only the
/// certificate prints, are refused as well. Sessions that hold them can still be read.
Bench parse_bench_file(const std::string& text, const std::string& name = "bench");

/// The bench as JSON text: `document` with targets, mount and known mechanisms brought up to date.
std::string to_json_text(const Bench& bench);

}  // namespace fit
