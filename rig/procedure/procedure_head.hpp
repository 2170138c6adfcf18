// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "rig/procedure/procedure.hpp"

namespace rig {

// What stands in a procedure file before its steps.

[[nodiscard]] const std::vector<std::string>& top_keys();
[[nodiscard]] const std::vector<Option>& stage_options();
[[nodiscard]] const std::vector<Option>& limit_options();

[[nodiscard]] StageRules read_stage(const Node& node, const Variables& variables);
[[nodiscard]] Limit read_limit(const Node& node, const Variables& variables);
/// In the file's order, each of which may use those before it; `overrides` come from the command line.
[[nodiscard]] Variables read_variables(const Node& node, const Variables& overrides);
[[nodiscard]] bool is_variable_name(const std::string& name);

}  // namespace rig
