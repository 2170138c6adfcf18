// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "fit/range/correction.hpp"
#include "fit/recording.hpp"

namespace rig {

/// One beam of a capture: mean range and intensity over all scans.
struct MeanBeam {
  double direction_rad, range_mm, intensity;
};

/// A flat target as one capture saw it.
struct FlatSurface {
  std::string label;
  double stage_rad = 0;
  std::optional<double> temperature_c;
  Eigen::Vector2d normal = Eigen::Vector2d::UnitY();  ///< Of the target, in the lidar's frame, by the bench.
  std::vector<MeanBeam> beams;
};

/// Beams that meet the target, by the bench's geometry and by what they saw. `wanted`: its name; empty: the
/// capture's own. None where the capture turned, was of another target, or has no such beam.
[[nodiscard]] std::optional<FlatSurface> surface_of(const fit::Recording& recording, std::size_t index,
                                                    const std::string& wanted, const fit::Mount& mount);

/// Its points in the lidar's frame, mm, turned so that the ordinate lies across the surface; with ranges
/// corrected, or as they were measured (null).
[[nodiscard]] std::vector<Eigen::Vector2d> surface_points(const FlatSurface& surface,
                                                          const fit::Correction* correction);

/// Where a beam's echo lies at that range, in the lidar's frame.
[[nodiscard]] Eigen::Vector2d point_of(const MeanBeam& beam, double range_mm);

}  // namespace rig
