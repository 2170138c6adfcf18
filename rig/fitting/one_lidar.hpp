// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "rig/fitting/fitting.hpp"

namespace rig {

/// "UST-10LX H1234567", as the lidar reports it; the bench's model where the session has none.
[[nodiscard]] std::string lidar_in_words(const SessionStore& session);

/// Throws UsageError, with both names and what to do, unless all sessions are of one lidar. Sessions that do
/// not tell a serial number go with any of the same model. `what`: "noise", "range calibration".
void demand_one_lidar(const std::vector<FitSource>& sources, const std::string& what);

}  // namespace rig
