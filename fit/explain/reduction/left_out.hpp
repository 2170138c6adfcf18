// SPDX-License-Identifier: MIT
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "fit/explain/reduction/reduce.hpp"
#include "fit/explain/reduction/selected_captures.hpp"

/// What of recordings is left out before anything is compared, as it says nothing of lidar and targets.
namespace fit::explain::reduction {

/// Sectors of beams, first and last angle (rad).
using Sectors = std::vector<std::pair<double, double>>;

/// Takes the beams out that return nothing in any capture, though beams on both sides of them see the very
/// surface on which they fall: a dead pixel or something before the window, and no loss of weak echoes.
/// Returns where they are.
Sectors leave_out_dead_beams(Reduced& reduced);

/// Takes single beams out that read otherwise than those beside them on the same surface, from three stops of
/// the stage or more, and a fifth of all: by far more than beams differ elsewhere. Returns where they are.
Sectors leave_out_odd_beams(Reduced& reduced);

/// A stretch of a target that is not there: a door, a pane of glass, something dark; or something stands out
/// from it, or back.
struct Opening {
  int target = 0;
  double from_mm = 0, to_mm = 0;  ///< Along the target, from its middle.
  int captures = 0;               ///< In which it was seen.
  double off_mm = 0;  ///< By how much ranges are longer there, median; `off_target_mm`: all through.
};

/// Takes the cells out that look at a stretch of a target from which nothing comes back, or what stands far
/// behind or surely elsewhere, while the target is there at one end at once and goes on at the other. The
/// stretch stays in its place while the stage turns, so that other beams look at it. It is no loss of weak
/// echoes, no light that falls on some beams, and nothing that the lidar does.
std::vector<Opening> leave_out_openings(Reduced& reduced);

/// Takes out targets that some captures meet where, in so many others, beams find nothing at all of them, or
/// what stands far behind: a board that was carried away.
std::map<int, int> leave_out_absent_targets(Reduced& reduced);

/// Takes out targets that hardly a beam meets where the bench file has them, though many should: `unmet` from
/// then on.
void leave_out_unmet_targets(Reduced& reduced);

/// A capture whose ranges fit the bench file, but not from where it says that stage or target stood.
struct MisplacedCapture {
  int capture = 0;
  double stage_rad = 0, target_shift_mm = 0;  ///< Where it fits.
};

/// The captures that do not fit the bench file as they are stated, though most others do and they fit at
/// another stage angle, or with the target at another of the recorded distances: exchanged, or mistyped.
/// `recordings`: of which the captures were reduced, in that order.
[[nodiscard]] std::vector<MisplacedCapture> misplaced_captures(
    const Reduced& reduced, const std::vector<const Recording*>& recordings);

}  // namespace fit::explain::reduction

namespace fit::explain {

/// Recordings, in their order, without the captures in which the lidar merged neighbouring steps (SCIP's
/// cluster count). Of a cluster it sends the nearest range: the smallest of several noisy readings, across a
/// slanted wall the near end's. That is shorter than any single beam's, by no physics that could be missing,
/// and scatters less. Throws std::invalid_argument if captures were recorded and none is left.
[[nodiscard]] std::vector<SelectedCaptures> single_beams(const std::vector<const Recording*>& recordings);

/// A sentence for the operator; empty if nothing was left out.
[[nodiscard]] std::string note_on_clusters(const std::vector<SelectedCaptures>& recordings);

}  // namespace fit::explain
