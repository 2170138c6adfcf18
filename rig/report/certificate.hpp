// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "rig/session/session_store.hpp"

namespace rig {

/// The calibration certificate of a session as data (`certificate/1`, docs/operate/certificate.md).
/// `previous`: the calibration before it as an archive has it (`previous/1`, docs/operate/laboratory.md),
/// which then stands beside the new one, or null.
[[nodiscard]] nlohmann::json make_certificate(const SessionStore& session, const std::string& session_file,
                                              const nlohmann::json& previous);
[[nodiscard]] nlohmann::json make_certificate(const SessionStore& session, const std::string& session_file);

}  // namespace rig
