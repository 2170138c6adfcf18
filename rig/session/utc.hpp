// SPDX-License-Identifier: MIT
#pragma once

#include <ctime>
#include <string>

namespace rig {

/// "2026-05-04T10:00:00Z".
[[nodiscard]] std::string utc_text(std::time_t seconds);

}  // namespace rig
