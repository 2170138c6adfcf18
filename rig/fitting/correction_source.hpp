// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "fit/range/correction.hpp"
#include "rig/session/session_store.hpp"

namespace rig {

/// The correction in a file (`correction/1`) or in the newest range calibration of a session, with a note if
/// that is no certificate. Throws UsageError (unreadable, not a correction) or MeasurementError (a session
/// without one).
[[nodiscard]] fit::Correction load_correction(const std::string& path);
[[nodiscard]] fit::Correction load_correction(const std::string& path, const SessionStore& session);

/// The rotation centre of a session's newest centre calibration, mm in the lidar's frame; nothing if it has
/// none.
[[nodiscard]] std::optional<Eigen::Vector2d> centre_of(const SessionStore& session);
/// The same of the session `path`; throws MeasurementError if it has none.
[[nodiscard]] Eigen::Vector2d load_centre(const std::string& path, const SessionStore& session);

}  // namespace rig
