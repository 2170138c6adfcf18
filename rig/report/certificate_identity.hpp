// SPDX-License-Identifier: MIT
#pragma once
// What was calibrated, by whom, and under which conditions: the first rows of a certificate.

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "fit/recording.hpp"
#include "rig/session/session_store.hpp"

namespace rig {

/// Name, version and hash of the procedure: what was done can be looked up, and that it was this.
[[nodiscard]] std::string procedure_in_words(const SessionStore& session);

/// The row that names the session's file.
inline constexpr const char* session_row = "Session";

/// Laboratory, customer, device, stage, bench and procedure: rows {"name", "text"}. `bench`: the session's
/// bench file.
[[nodiscard]] nlohmann::json identification(const SessionStore& session, const nlohmann::json& bench,
                                            const std::string& session_file);

/// Dates, captures, and the surroundings as prompts or the bench file state them: rows {"name", "text"}.
[[nodiscard]] nlohmann::json conditions(const SessionStore& session, const nlohmann::json& bench,
                                        const fit::Recording& recording);

}  // namespace rig
