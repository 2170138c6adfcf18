// SPDX-License-Identifier: MIT
#include "rig/procedure/procedure.hpp"

#include <algorithm>
#include <fstream>

#include "rig/output_place.hpp"
#include "rig/procedure/option_check.hpp"
#include "rig/procedure/procedure_document.hpp"
#include "rig/procedure/procedure_head.hpp"
#include "rig/procedure/step_reader.hpp"

namespace rig {
namespace {

Procedure procedure_of(const Node& root, const Variables& overrides) {
  Procedure procedure;
  if (root.kind != Node::Kind::map)
    throw ProcedureError(root.position,
                         "a procedure file is a map with the keys " + listed(top_keys()) + ".");
  for (const auto& [key, value] : root.members)
    if (std::ranges::find(top_keys(), key.scalar) == top_keys().end())
      refuse_key(key, "a procedure file", top_keys());
  const auto text = [&](const char* key, bool required) -> std::string {
    const Node* node = root.find(key);
    if (!node && required)
      throw ProcedureError(root.position,
                           std::string("'") + key + "' is missing: give the procedure a name.");
    if (node && node->kind != Node::Kind::scalar)
      throw ProcedureError(node->position, std::string("'") + key + "' must be a text.");
    return node ? node->scalar : "";
  };
  procedure.name = text("procedure", true);
  procedure.title = text("title", false);
  procedure.about = text("about", false);
  procedure.source = text("source", false);
  if (procedure.title.empty()) procedure.title = procedure.name;
  Node nothing;
  nothing.position = root.position;
  const Node* variables = root.find("variables");
  if (variables && variables->kind != Node::Kind::map && variables->kind != Node::Kind::nothing)
    throw ProcedureError(variables->position, "'variables' must be a map {name: value}.");
  procedure.variables = read_variables(variables ? *variables : nothing, overrides);
  if (const Node* stage = root.find("stage")) procedure.stage = read_stage(*stage, procedure.variables);
  if (const Node* limits = root.find("limits")) {
    if (limits->kind != Node::Kind::list) throw ProcedureError(limits->position, "'limits' must be a list.");
    for (const Node& limit : limits->items)
      procedure.limits.push_back(read_limit(limit, procedure.variables));
  }
  const Node* steps = root.find("steps");
  if (!steps) throw ProcedureError(root.position, "'steps' is missing: a procedure needs at least one step.");
  procedure.steps = read_steps(*steps, procedure.variables);
  return procedure;
}

}  // namespace

Procedure parse_procedure(const std::string& text, const std::string& file, const Variables& overrides) {
  Procedure procedure = procedure_of(read_document(text, file), overrides);
  procedure.file = file;
  procedure.text = text;
  return procedure;
}

Procedure read_procedure(const std::string& path, const Variables& overrides) {
  if (is_recording(path))
    throw UsageError(path + " is a session, not a procedure. To continue its run: rig resume " + path + ".");
  std::ifstream in(path, std::ios::binary);
  if (!in) throw UsageError(path + ": cannot be read. Check the name and its permissions.");
  std::string text(largest_procedure_bytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  return parse_procedure(text, path, overrides);
}

}  // namespace rig
