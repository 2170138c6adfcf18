// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include "fit/correction.hpp"
#include "rig/session/session_store.hpp"

namespace rig {

/// The correction in a file (`correction/1`) or in the newest range calibration of a session. Throws
/// UsageError (unreadable, not a correction) or MeasurementError (a session without one).
[[nodiscard]] fit::Correction load_correction(const std::string& path);
[[nodiscard]] fit::Correction load_correction(const std::string& path, const SessionStore& session);

}  // namespace rig
