// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "random.hpp"

namespace challenge {

using Vector = Eigen::Vector2d;
inline constexpr double pi = 3.14159265358979323846;
inline constexpr double degree = pi / 180;
inline constexpr double light_mm_per_ns = 299.792458 / 2;  ///< Range per nanosecond of echo delay.

/// A flat target as the bench file states it.
struct Wall {
  std::string name;
  Vector from, to;
  double reflectance = 0.5;
  double u_mm = 1.5, u_deg = 0.1;
  bool closed =
      false;  ///< Part of a closed outline: its ends meet the neighbours wherever they really stand.
};

struct Capture {
  double since_power_on_s = 0;
  double stage_deg = 0;
  int approach = 0;
  int target = -1;  ///< Index of the wall it is about; -1: the whole scene.
  double shift_mm = 0;
  double reflectance = -1;  ///< Negative: the wall's own.
  double temperature_c = 25;
  double rate_deg_s = 0;
  double first_scan_s = 0;  ///< Seconds from the end of the move to the first scan.
  int first_step = 0, last_step = 1080;
  int scans = 10;
};

/// Where things really are, relative to what the bench says.
struct Nuisance {
  double x_mm = 0, y_mm = 0, yaw_rad = 0;
  std::vector<double> offset_mm, tilt_rad;  ///< One for each wall.
};

/// Which way takes what is off already farther from where the bench file has it; the other brings it nearer.
inline double away(double already) { return already < 0 ? -1 : 1; }

/// How a concealed device turns power into counts; drawn anew for every session.
struct Radiometer {
  double exponent = 0.5, knee = 1;
  [[nodiscard]] double counts(double power) const {
    const double p = std::pow(power, exponent);
    return 2600 * p / (p + knee);
  }
};

/// Everything that is not concealed physics: the bench, what was done, and the honest randomness.
struct Session {
  std::string scene;
  int steps = 1081, front_step = 540;
  double step_deg = 0.25, scan_hz = 40;
  double u_mount_mm = 3, u_yaw_deg = 0.3;
  double sigma_mm = 5, u_sigma_mm = 1;
  double stated_sigma_mm = 5;
  std::vector<Wall> walls;
  std::vector<Capture> captures;
  Nuisance truth;
  Radiometer radiometer;
  bool thermometer = false;
  /// The bench states the law of its intensity (`radiometry`): then that is something to explain as well.
  bool claims_intensity = false;
  double counts_noise = 0.02;  ///< Relative, of one sample's intensity, where it is claimed.
  double u_gain = 0.05, u_power = 0.02, u_overlap_mm = 5;
  double claimed_gain = 900, claimed_power = 0.5, claimed_full = 2800, claimed_overlap_mm = 80;

  [[nodiscard]] double beam_rad(int step) const { return (step - front_step) * step_deg * degree; }
  [[nodiscard]] double beam_time_s(int step) const { return step * step_deg / 360 / scan_hz; }
};

/// Names of the scenes that make_scene knows.
const std::vector<std::string>& scenes();

/// Draws a session of that kind: another room, other angles, other numbers of scans for every seed. Throws
/// std::invalid_argument for an unknown scene.
Session make_scene(const std::string& scene, Random& random);

}  // namespace challenge
