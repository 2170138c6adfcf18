// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include "rig/procedure/procedure.hpp"

namespace rig {

constexpr std::size_t largest_procedure_bytes = 1 << 20;

/// The text of a procedure file as a tree in which everything knows its place. Throws ProcedureError when it
/// is no YAML, or grows without bound.
[[nodiscard]] Node read_document(const std::string& text, const std::string& file);

}  // namespace rig
