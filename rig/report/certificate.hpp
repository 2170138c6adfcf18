// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "rig/session/session_store.hpp"

namespace rig {

/// The calibration certificate of a session as data (`certificate/1`, docs/report.md).
[[nodiscard]] nlohmann::json make_certificate(const SessionStore& session, const std::string& session_file);

}  // namespace rig
