// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/model/hypothesis.hpp"
#include "fit/explain/numbers.hpp"

namespace fit::explain {

struct HeldOutFigures {
  double log_likelihood = 0, rms_mm = 0, coverage = 0, cells = 0;
};

/// What the means came to.
struct MeanResult {
  explicit MeanResult(const Bench& bench) : best(bench) {}
  Hypothesis best;
  bool shapes_carry_over = true;  ///< To captures that had no part in them.
  HeldOutFigures before, after;   ///< The log-likelihood is of all channels.
  /// Held-out captures lie farther off with what was found than without.
  [[nodiscard]] bool is_worse_held_out() const { return after.rms_mm > 1.1 * before.rms_mm; }
  HeldOutFigures without_functions;  ///< Of names alone; as `after` where no function is.
  /// What functions without a name would have to explain is more than lidars err by, in most of what was
  /// seen.
  [[nodiscard]] bool is_another_scene() const {
    return without_functions.rms_mm > numbers::another_scene_mm &&
           without_functions.coverage < numbers::describes_at;
  }
  double noise_floor_mm = 0;
  double excess = 1;  ///< Factor on the variance of the means.
  MeanNoise noise;
};

}  // namespace fit::explain
