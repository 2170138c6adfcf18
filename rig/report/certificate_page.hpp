// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace rig {

/// The certificate (make_certificate) as one HTML page that needs nothing else and prints well.
[[nodiscard]] std::string to_html(const nlohmann::json& certificate);

}  // namespace rig
