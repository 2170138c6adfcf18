// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace rig {

/// An explanation (`explanation/1`) as one HTML page with pictures that needs nothing else and prints well.
[[nodiscard]] std::string explanation_html(const nlohmann::json& explanation, const std::string& sessions);

}  // namespace rig
