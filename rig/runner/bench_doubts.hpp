// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/bench/bench.hpp"

namespace rig {

/// Values that no bench of a scanning lidar has, but a bench file in other units does: a sentence each, with
/// the key, the value and what is usual. A person may confirm them.
[[nodiscard]] std::vector<std::string> doubts_about(const fit::Bench& bench);

}  // namespace rig
