// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>

#include "rig/archive/session_record.hpp"

namespace rig {

/// `fleet/1` (docs/operate/laboratory.md): what all sessions of an archive say together. Mechanisms and how
/// often they were named, their sizes by model and age, unknown physics put together by its shape, lidars
/// that drift, sessions whose results are another lidar's.
[[nodiscard]] nlohmann::json fleet_of(std::span<const SessionRecord> archive);

/// The page of a fleet.
[[nodiscard]] std::string fleet_html(const nlohmann::json& fleet);

}  // namespace rig
