// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "rig/session/session_store.hpp"

namespace rig {

/// When what a session holds was measured, which for an imported one is not when the file was made. Texts as
/// the session has them (UTC, ISO 8601); empty: not known.
struct SessionDates {
  std::string measured_utc;    ///< Imported: by the clock of the recording.
  std::string measured_local;  ///< As an imported recording has it, where it tells no UTC.
  std::string imported_utc;    ///< Empty unless imported.

  /// In words, for certificates; empty if nothing is known.
  [[nodiscard]] std::string measured() const;
};
[[nodiscard]] SessionDates dates_of(const SessionStore& session);

/// The system's time, in microseconds of Unix, at which the session's host time is 0. Nothing where the
/// session does not say it, or not as a number.
[[nodiscard]] std::optional<std::int64_t> epoch_unix_us(const SessionStore& session);

/// The date YYYY-MM-DD with which a text begins; empty if it begins otherwise.
[[nodiscard]] std::string date_in(const std::string& text);

}  // namespace rig
