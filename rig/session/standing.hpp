// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "rig/session/session_store.hpp"

namespace rig {

/// Whether what a session holds may be certified, and if not, why. A document about it is then a report.
struct Standing {
  bool simulated = false;            ///< Devices or targets were a simulator's.
  std::vector<std::string> reasons;  ///< Against a certificate, whole sentences; empty: nothing is.
  [[nodiscard]] bool certifies() const { return reasons.empty(); }
};

/// How the procedure ended before its last step, or that nothing says that it ended; empty if all that it
/// measures and computes is there, or no procedure made the session.
[[nodiscard]] std::string unfinished(const SessionStore& session);

/// What the key `ended` says while nothing but reports is left to do.
inline constexpr const char* ended_but_for_reports = "all but its reports";

/// What speaks against a result as a whole: contradictions, and methods that do not agree. Whole sentences.
[[nodiscard]] std::vector<std::string> doubts_of(const nlohmann::json& result);

/// From the newest results (their values, `contradictions` and `comparisons`), the identification of lidar
/// and laboratory, and how the run ended.
[[nodiscard]] Standing standing_of(const SessionStore& session);

/// Whether a device says of itself that it is simulated: the word stands in an answer of its own.
[[nodiscard]] bool says_simulated(const std::string& answers);

}  // namespace rig
