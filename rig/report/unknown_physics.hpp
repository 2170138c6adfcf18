// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>

namespace rig {

/// What the last explanation (explanation/1) found and no mechanism makes, as rows and a sentence: the
/// calibration knows nothing of it. Null if it found no such thing.
[[nodiscard]] nlohmann::json unknown_physics(const nlohmann::json& explanation);

}  // namespace rig
