// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace rig {

/// The dossier of an investigation (`dossier/2`, docs/operate/investigate.md) as one HTML page that needs
/// nothing else and prints well: what was found and how it was decided on the first page, prediction against
/// recording on the second, details behind.
[[nodiscard]] std::string dossier_page(const nlohmann::json& dossier);

}  // namespace rig
