// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "fit/explain/explanation.hpp"

namespace fit::explain {

/// What the bench can do to separate suspects: a list of captures and what the operator changes between them.
struct Experiment {
  enum class Kind { all_round, both_sides, ladder, greys, heat, cold_start, turning };
  Kind kind = Kind::all_round;
  std::string target;  ///< For ladder and greys.
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

/// Of these the one that tells most about who of the suspects it is, given what the recordings already say:
/// for every pair, the evidence that the effect of one would leave when the other, the nuisance parameters
/// and their priors try to take it up. Of experiments that tell the same, the one with less work. Empty when
/// fewer than two suspects or none tells any of them apart. Suspects of the intensity are judged in the same
/// way by the logarithm of intensity.
[[nodiscard]] std::optional<Experiment> best_experiment(const std::vector<const Recording*>& recordings,
                                                        const Explanation& explanation,
                                                        const StageTravel& travel);

/// The same for targets that are put up by hand (`placed_anew`): distances and greys, every one a placement
/// with the bench file's uncertainty, and no stage.
[[nodiscard]] std::optional<Experiment> best_experiment_by_hand(
    const std::vector<const Recording*>& recordings, const Explanation& explanation);

}  // namespace fit::explain
