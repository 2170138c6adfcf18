// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "lidar/scan.hpp"

namespace rig {

/// Where the stage said it was while it turned, and a line through that. Times in seconds, angles in degrees.
class TurnTrack {
 public:
  struct Line {
    double at_deg = 0, rate_deg_s = 0;
  };

  /// It was at `deg` at some moment within `half_s` of `s`: between question and answer.
  void add(double s, double deg, double half_s);
  [[nodiscard]] std::size_t size() const { return poses_.size(); }
  /// The line at the time `s`, by least squares. What was answered late counts for less.
  [[nodiscard]] Line line_at(double s) const;
  /// In words, why scans along it have no known angles: it is no straight line, or one at another rate than
  /// `commanded_deg_s`; empty if nothing is wrong. `resolution_deg` is the stage's.
  [[nodiscard]] std::string disturbance(double commanded_deg_s, double resolution_deg) const;

 private:
  struct Pose {
    double s = 0, deg = 0, half_s = 0;
  };
  std::vector<Pose> poses_;
};

/// What came in while the stage turned.
struct TurningScans {
  std::vector<lidar::Scan> scans;
  TurnTrack track;
};

}  // namespace rig
