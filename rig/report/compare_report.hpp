// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fit/range/recording_statistics.hpp"

namespace rig {

/// Two devices compared. `first_half` and `second_half` are those of the one that was recorded: what it
/// differs from itself is the measure for what the other differs from it.
struct Comparison {
  std::string name, other_name;
  fit::RecordingStatistics recorded, other, first_half, second_half;
};

/// `comparison/1`: distances, and which statistics agree.
[[nodiscard]] nlohmann::json comparison_json(const Comparison& comparison);
/// One self-contained page of plots and distances.
[[nodiscard]] std::string comparison_html(const Comparison& comparison);

}  // namespace rig
