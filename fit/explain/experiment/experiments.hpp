// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/explain/reduction/temperature.hpp"
#include "fit/recording.hpp"

namespace fit::explain {

/// What the bench can do to separate suspects: a list of captures and what the operator changes between them.
struct Experiment {
  enum class Kind { all_round, both_sides, ladder, greys, dark, heat, cold_start, turning };
  Kind kind = Kind::all_round;
  std::string title;
  std::vector<CaptureInfo> captures;
  int scans = 10;
  /// What it is expected to tell (nats) about which suspect it is, if every one is as probable as another.
  double information = 0;
  /// Log of the odds by which it is expected to tell those apart that it tells apart least.
  double expected = 0;
  /// Ids of the suspects; those that it cannot tell apart are in one group.
  std::vector<std::vector<std::string>> groups;
  bool by_hand = false;  ///< The target is put up anew for every capture; no stage is needed.
  bool steady = false;   ///< Begins with the lidar warm, at a housing temperature that is read.
};

/// Travel that the stage is allowed, radians.
struct StageTravel {
  double from_rad = -pi, to_rad = pi;
};

/// All experiments that this bench could do.
[[nodiscard]] std::vector<Experiment> possible_experiments(const Bench& bench, const StageTravel& travel);

/// Distances and greys for the targets that people put up (`placed_anew`), of those that were used so far;
/// every one a placement by hand, and no stage.
[[nodiscard]] std::vector<Experiment> experiments_by_hand(const Bench& bench,
                                                          const std::vector<const Recording*>& so_far);

/// Leaves out the captures of moved targets that the middle of their beams would not meet: behind another
/// target, or beside the lidar's field of view.
void leave_out_hidden(Experiment& experiment, const Bench& bench);

/// Whether a target that wide can be moved: nobody moves a wall.
[[nodiscard]] bool is_movable(const Target& target);

/// Beams that meet the target's middle from stage angle 0.
[[nodiscard]] CaptureInfo aimed_at(const Bench& bench, const Target& target);

/// Seconds of somebody's day that it takes.
[[nodiscard]] double work_s(const Experiment& experiment);

}  // namespace fit::explain
