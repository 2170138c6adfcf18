// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <span>

namespace fit {

/// Source A, experiment A3: standard deviation of the difference between each ordinate and the `lag`-th
/// before it, with a 95 % interval from blocks of neighbours left out in turn (jackknife). As the paper
/// computes it, and after the best plane was removed (a slanted wall alone gives a large figure).
struct DifferenceSpread {
  double sd_mm = 0, low_mm = 0, high_mm = 0;
  double plane_sd_mm = 0, plane_low_mm = 0, plane_high_mm = 0;
  long pairs = 0;
};
[[nodiscard]] DifferenceSpread difference_spread(std::span<const Eigen::Vector2d> points, int lag);

/// Source A, experiment A6: distance from each point of `a` to the line through neighbouring points of `b`,
/// averaged over those nearer than `gate_mm`. NaN when there is none.
struct SceneDistance {
  double mean_mm = 0, u_mm = 0;
  long pairs = 0;
};
[[nodiscard]] SceneDistance scene_distance(std::span<const Eigen::Vector2d> a,
                                           std::span<const Eigen::Vector2d> b, double gate_mm);

}  // namespace fit
