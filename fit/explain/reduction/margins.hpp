// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

#include "fit/explain/reduction/reduce.hpp"
#include "fit/numeric/angle.hpp"

namespace fit::explain::reduction {

/// In standard uncertainties of the mount: which wall a beam near a corner meets depends on where mount and
/// walls really are.
constexpr double coverage_of_mount = 3;

/// How far along a wall (mm) a beam may be off at that range, in so many standard uncertainties of the mount.
[[nodiscard]] double place_uncertainty_mm(const Mount& mount, double range_mm, double uncertainties);

/// How far (rad) the outermost of the beams that a cell has taken together is from their middle: as if they
/// lay side by side without a gap.
[[nodiscard]] inline double half_width_rad(const Cell& cell) { return std::sqrt(3.0) * cell.joined_rad; }

/// How near (mm) to a corner of its target a beam whose place is that uncertain, and that is so wide to
/// either side, may come for its mean to be compared.
[[nodiscard]] double corner_margin_mm(const Sight& sight, double place_uncertainty_mm, double half_rad);

/// Standard uncertainty of the range at which a beam meets a target, by what the bench file says of both, mm.
[[nodiscard]] double misplaced_mm(const Bench& bench, const Sight& sight);

/// Within this of an edge, samples may be of both surfaces.
inline constexpr double edge_window_rad = 2.5 * rad_per_deg;

/// Within this of an edge, part of a beam of usual width passes it.
inline constexpr double beside_rad = 0.5 * rad_per_deg;

/// From this incidence on ranges hang too much on where a surface is; a round one ends soon after.
[[nodiscard]] inline double grazing_rad(const Target& target) {
  return (target.round ? 65 : 78) * rad_per_deg;
}

/// Standard half width of a beam where no edge shows it.
inline constexpr double usual_width_rad = 0.15 * rad_per_deg;

/// So many standard half widths from an edge no part of a beam that matters passes it.
inline constexpr double widths_of_beam = 3.5;

/// What the mean of a beam that wide, so far from an edge of that depth (0: nothing behind), may be off
/// because part of it passes the edge: the rest meets the surface aside, and what passes meets the one
/// behind. Standard uncertainty, mm.
[[nodiscard]] double u_at_edge_mm(const Sight& sight, double edge_rad, double gap_mm, double width_rad);

/// States of every cell what its mean may be off because a beam of that standard half width meets a second
/// surface too: beside an edge as much as both are apart, beside an inner corner a share of what the mean
/// over the beam makes of it. How a receiver mixes both no formula says well enough.
void state_u_of_wide_beams(Reduced& reduced, double width_rad);

/// Cells where the next bin of a comb begins: whether a mean is on this side of it or on that, mount and
/// targets do not say, nor a stage whose stops scatter by that variance.
void state_u_of_bin_edges(Reduced& reduced, double bin_mm, double zero, double stop_rad2);

/// States of cells that count and meet another target there than their own by how much both are apart. They
/// are seen on their own target's plane, and stay rows of it.
void state_u_of_other_targets(Reduced& reduced, const Nuisance& nuisance, const std::vector<Active>& at_work);

}  // namespace fit::explain::reduction
