// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "rig/procedure/procedure.hpp"
#include "rig/text_lines.hpp"

namespace rig {

// What is written is laid beside what a step, the stage or a limit takes; whatever does not fit is a
// ProcedureError at its place, with what was expected.

/// Throws if a member of the map is not known, does not fit, or is missing; `of` names whose options they
/// are.
void check_map(const Node& node, const std::vector<Option>& known, const std::string& of,
               const Variables& variables);
/// A NaN (not known yet) fits.
void check_in_range(const Node& node, const Option& option, double number);
[[noreturn]] void refuse_value(const Node& node, const Option& option, const std::string& got);
[[noreturn]] void refuse_key(const Node& key, const std::string& of, const std::vector<std::string>& known);

/// The value of what is written, its expressions evaluated.
[[nodiscard]] Value evaluated(const Node& node, const Variables& variables);

}  // namespace rig
