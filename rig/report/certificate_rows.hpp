// SPDX-License-Identifier: MIT
#pragma once
// What the parts of a certificate have in common: rows of a name and a text.

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

namespace rig {

/// A key of the session that holds JSON; an empty object where it holds none.
[[nodiscard]] nlohmann::json json_or_empty(const std::optional<std::string>& text);
/// Adds {"name", "text"}; an empty text is "not stated".
void add_row(nlohmann::json& rows, const std::string& name, const std::string& text);

}  // namespace rig
