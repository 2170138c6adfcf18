// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fit/range/recording_statistics.hpp"

namespace rig {

/// A device and its sessions; the halves say how far it differs from itself.
struct ComparedDevice {
  std::string name;
  std::vector<std::string> files;
  fit::RecordingStatistics all, first_half, second_half;
};

struct Comparison {
  ComparedDevice recorded, other;
};

/// `comparison/1`: distances, and which statistics agree. Which of the two is `recorded` does not matter, and
/// two recordings of one device differ in any statistic at most once in 20 times (Holm).
[[nodiscard]] nlohmann::json comparison_json(const Comparison& comparison);
/// One self-contained page of plots and distances.
[[nodiscard]] std::string comparison_html(const Comparison& comparison);

}  // namespace rig
