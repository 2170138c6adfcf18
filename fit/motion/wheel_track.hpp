// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "fit/motion/deskew.hpp"
#include "fit/motion/odometry.hpp"
#include "fit/motion/wheel_time.hpp"
#include "fit/recording.hpp"

namespace fit {

/// Stamps of what happens evenly, seconds, without the chance by which they came late: lines through the 201
/// stamps around each. Across a gap of more than three times the usual step nothing is evened.
[[nodiscard]] std::vector<double> even_times(const std::vector<double>& stamps);

/// Wheel angles of a recording, radians (left, right), in order of time, seconds.
class WheelTrack {
 public:
  explicit WheelTrack(const std::vector<TrackPose>& track);

  [[nodiscard]] std::size_t size() const { return known_.size(); }
  void make_times_even();
  [[nodiscard]] bool covers(double from, double to) const;

  // Between times that are covered:

  [[nodiscard]] Eigen::Vector2d at(double time_s) const;
  /// How far the wheels turned in each interval between the known times from `from` to `to`.
  [[nodiscard]] std::vector<Eigen::Vector2d> pieces(double from, double to) const;
  /// What the wheels did, without a match.
  [[nodiscard]] WheelSample sample_between(double from, double to) const;

  /// The path that a robot rolls by them.
  [[nodiscard]] Path path(const RobotGeometry& robot) const;
  [[nodiscard]] WheelTime over_time() const;

 private:
  struct At {
    double time_s;
    Eigen::Vector2d angle;
  };
  [[nodiscard]] std::vector<At>::const_iterator after(double time_s) const;

  std::vector<At> known_;
};

}  // namespace fit
