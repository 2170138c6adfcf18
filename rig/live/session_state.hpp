// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "rig/session/session_store.hpp"

namespace rig {

/// What a session file tells of a run, finished or going on elsewhere, as the live page's state
/// (docs/reference/live.md).
[[nodiscard]] nlohmann::json state_of(const SessionStore& session);

}  // namespace rig
