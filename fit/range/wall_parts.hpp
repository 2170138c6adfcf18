// SPDX-License-Identifier: MIT
#pragma once
// The parts of fit_wall(), in the order in which it takes them. For fit/wall*.cpp only.

#include <cmath>
#include <cstdint>
#include <vector>

#include "fit/range/wall.hpp"

namespace fit::wall_parts {

/// The mean range of one beam over the scans of a capture, and the wall it sees.
struct WallBeam {
  double angle = 0, range = 0, scans = 0, counts = 0;
  double off_mm = 0, off_rad = 0;  ///< Deviations of range and angle, once they were found and taken off.
  int wall = -1;
  [[nodiscard]] Eigen::Vector2d point() const { return {range * std::cos(angle), range * std::sin(angle)}; }
};

struct Station {
  double stage_rad = 0;
  double off_rad = 0;  ///< Deviation of that angle, once it was found.
  int approach = 0;
  std::vector<WallBeam> beams;
  std::vector<std::vector<std::uint16_t>> scans;  ///< Those that make points of the trajectory.
};

/// Means of every beam of a capture at rest, and its first `most_scans` scans.
Station read_station(const Recording& recording, std::size_t index, std::size_t most_scans);

/// The two boards that the bench or the options name, else those of the station nearest to stage angle 0.
/// Throws std::invalid_argument where there are none.
void find_walls(const Bench& bench, const Station& nearest_zero, const WallOptions& options, WallFit& fit);

/// Marks each beam with the wall it sees: the line in which `wall` is expected, if there is one.
void assign(Station& station, const WallInBench* walls, double yaw, const WallOptions& options);

/// Throws std::invalid_argument unless the stage turned enough between the captures.
void check_turned(const std::vector<Station>& stations);

/// Mounting angle, offset, walls and corner from all beams at once; takes the deviations found off the
/// stations.
void fit_joint(std::vector<Station>& stations, double yaw, const Mount& mount, const DeviceAccuracy& accuracy,
               WallFit& fit);

/// The patent's methods, beside the joint fit.
void fit_patent(const std::vector<Station>& stations, WallFit& fit);

}  // namespace fit::wall_parts
