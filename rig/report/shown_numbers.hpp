// SPDX-License-Identifier: MIT
#pragma once
// Values and tables of a result (result/1) as a page shows them: with the decimals that their uncertainties
// warrant.

#include <nlohmann/json_fwd.hpp>

namespace rig {

/// {"label", "value", "unit", "expanded", "k"}, all texts; the last two are empty for what has no
/// uncertainty.
[[nodiscard]] nlohmann::json shown_value(const nlohmann::json& value);

/// {"title", "wide", "columns", "rows"}: cells are {"text", "numeric", "short"}. Numbers of a column have the
/// same decimals, so that they can be compared.
[[nodiscard]] nlohmann::json shown_table(const nlohmann::json& table);

}  // namespace rig
