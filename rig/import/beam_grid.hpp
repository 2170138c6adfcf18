// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "fit/recording.hpp"

namespace rig {

/// Where the points of one scan lie on evenly spaced directions.
struct BeamGrid {
  fit::ScanGeometry geometry;
  std::vector<std::size_t> place;  ///< Of each point, from 0.
  std::size_t beams = 0;
  double farthest_rad = 0;  ///< How far a point lies off its direction, at most.
  std::size_t doubled = 0;  ///< Points on a direction that another has already.
};

/// Finds the even grid of directions that the points of one scan, listed in the order of their angles, were
/// measured on; directions without an echo may be missing. `known` gives first and step instead. Nothing
/// where the angles neither grow nor fall, or lie on no grid of fewer than 100,000 directions.
[[nodiscard]] std::optional<BeamGrid> beam_grid(std::span<const double> angle_rad,
                                                const std::optional<fit::ScanGeometry>& known = {});

}  // namespace rig
