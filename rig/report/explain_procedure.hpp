// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include "fit/explain/experiment/next_experiment.hpp"

namespace rig {

/// Sentences that say whom of the suspects it is expected to tell apart, how surely, and whom it leaves
/// together.
[[nodiscard]] std::string promise_of(const fit::explain::Experiment& experiment);

/// The experiment as a procedure file that runs as it stands on the bench it was made for.
[[nodiscard]] std::string procedure_text(const fit::explain::Experiment& experiment, const fit::Bench& bench);

/// Its steps alone, as they stand below `steps:`; the stage is homed.
[[nodiscard]] std::string steps_text(const fit::explain::Experiment& experiment,
                                     const fit::LidarGeometry& lidar);

/// A text as a quoted YAML scalar.
[[nodiscard]] std::string yaml_quoted(const std::string& text);

}  // namespace rig
