// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain {

/// How far from its place in the bench an edge is looked for.
inline constexpr double edge_reach_deg = 1.2;

/// One beam near an edge.
struct Beside {
  double inside_deg = 0;  ///< From where the bench has the edge; positive on the nearer surface.
  double far_share = 0, n = 0;
  bool between = false;
  double on_neither = 0;            ///< Samples between the two surfaces.
  double counts = 0, u_counts = 0;  ///< Mean intensity where all samples met one surface; 0: not known.
  double log_echo = 0;              ///< By geometry alone: cosine of the incidence, inverse square of range.
  /// Place of the mean between the planes of the two surfaces, not cut off at them, and its noise.
  double place = 0, u_place = 0;
  int target = -1;  ///< That it meets where mount and targets are as predicted.
};

/// Log-likelihood of shares of the farther surface, which takes over there within that standard width.
[[nodiscard]] double likelihood_of_edge(const std::vector<Beside>& beams, double shift_deg, double width_deg);

/// Where the farther surface takes over for beams that wide, and how likely their shares are there.
struct PlaceOfEdge {
  double shift_deg = 0, log_likelihood = -1e300;
};
/// Within the reach of `about_deg`. Between two beams a hard edge may lie anywhere: it is told in the middle
/// of the places that are as likely as the best.
[[nodiscard]] PlaceOfEdge place_of_edge(const std::vector<Beside>& beams, double width_deg, double about_deg);

/// One edge of the scene, seen in some captures.
struct SeenEdge {
  std::vector<Beside> beams;
  double gap_mm = 0;
  Eigen::Vector2d from = Eigen::Vector2d::Zero();  ///< Where it is seen from ...
  double bearing_rad = 0;                          ///< ... in which direction, ...
  int near_side = 1;
  double shift_deg = 0;
  bool settled = false;
};

/// Every edge of the scene as the recording shows it, by its id (scene.hpp); captures in which its target was
/// moved or the stage turned are left out.
[[nodiscard]] std::map<int, SeenEdge> seen_edges(const Reduced& reduced, const Nuisance& nuisance,
                                                 const std::vector<Active>& at_work);

}  // namespace fit::explain
