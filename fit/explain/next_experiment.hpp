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
  /// Log of the odds by which it is expected to separate the two suspects that it separates least.
  double expected = 0;
};

/// Travel that the stage is allowed, radians.
struct StageTravel {
  double from_rad = -pi, to_rad = pi;
};

/// All experiments that this bench could do.
[[nodiscard]] std::vector<Experiment> possible_experiments(const Bench& bench, const StageTravel& travel);

/// Of these the one that separates the suspects best, given what the recordings already say: for every pair,
/// the evidence that the effect of one would leave when the other, the nuisance parameters and their priors
/// try to take it up. Empty when fewer than two suspects or none separates them.
[[nodiscard]] std::optional<Experiment> best_experiment(const std::vector<const Recording*>& recordings,
                                                        const std::vector<Term>& suspects,
                                                        const StageTravel& travel);

}  // namespace fit::explain
