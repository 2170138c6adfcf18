// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "fit/explain/experiment/experiments.hpp"
#include "fit/explain/explanation.hpp"

namespace fit::explain {

/// Of all experiments that the bench can do, the one that tells most about who of the suspects it is, given
/// what the recordings already say: for every pair, the evidence that the effect of one would leave when the
/// other, the nuisance parameters and their priors try to take it up. Of experiments that tell the same, the
/// one with less work. Empty when fewer than two suspects or none tells any of them apart. Suspects of the
/// intensity are judged in the same way by the logarithm of intensity.
[[nodiscard]] std::optional<Experiment> best_experiment(const std::vector<const Recording*>& recordings,
                                                        const Explanation& explanation,
                                                        const StageTravel& travel);

/// All experiments that tell any of the suspects apart beside what is recorded, each with what it tells: for
/// whoever weighs that against more than best_experiment() knows of. Where targets were put up in several
/// places, by hand (`placed_anew`): distances and greys, every one a placement with the bench file's
/// uncertainty, and no stage.
[[nodiscard]] std::vector<Experiment> telling_experiments(const std::vector<const Recording*>& recordings,
                                                          const Explanation& explanation,
                                                          const StageTravel& travel);

}  // namespace fit::explain
