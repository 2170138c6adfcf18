// SPDX-License-Identifier: MIT
#include <algorithm>
#include <nlohmann/json.hpp>

#include "rig/procedure/procedure_head.hpp"
#include "rig/procedure/step.hpp"

namespace rig {
namespace {

using ordered = nlohmann::ordered_json;
using Type = Option::Type;

ordered map_schema(const std::vector<Option>& options);

ordered or_expression(ordered plain) {
  return {{"anyOf", {plain, {{"type", "string"}, {"pattern", "\\$\\{.+\\}"}}}}};
}

ordered option_schema(const Option& option) {
  ordered schema;
  switch (option.type) {
    case Type::number:
    case Type::integer:
      schema["type"] = option.type == Type::number ? "number" : "integer";
      if (option.min) schema["minimum"] = *option.min;
      if (option.max) schema["maximum"] = *option.max;
      schema = or_expression(schema);
      break;
    case Type::text:
    case Type::path:
      schema["type"] = {"string", "number"};
      break;
    case Type::flag:
      schema = or_expression({{"type", "boolean"}});
      break;
    case Type::numbers:
      schema = {{"type", "array"},
                {"items", or_expression({{"type", "number"}})},
                {"minItems", 2},
                {"maxItems", 2}};
      break;
    case Type::choice:
      schema["enum"] = option.choices;
      break;
    case Type::map:
      schema = option.members.empty() ? ordered{{"type", "object"}} : map_schema(option.members);
      break;
  }
  schema["description"] = option.about;
  return schema;
}

ordered map_schema(const std::vector<Option>& options) {
  ordered schema = {{"type", "object"}, {"additionalProperties", false}, {"properties", ordered::object()}};
  ordered required = ordered::array();
  for (const auto& option : options) {
    schema["properties"][option.name] = option_schema(option);
    if (option.required) required.push_back(option.name);
  }
  if (!required.empty()) schema["required"] = required;
  return schema;
}

ordered loop_schema() {
  const ordered number = or_expression({{"type", "number"}});
  const ordered range = {{"type", "object"},
                         {"properties", {{"from", number}, {"to", number}, {"step", number}}},
                         {"required", {"from", "to", "step"}},
                         {"additionalProperties", false}};
  const ordered each_with_each = {
      {"type", "object"},
      {"minProperties", 1},
      {"additionalProperties", {{"anyOf", {{{"type", "array"}, {"minItems", 1}}, range}}}}};
  const ordered turn = {{"type", "object"},
                        {"minProperties", 1},
                        {"additionalProperties", {{"type", {"number", "string", "boolean"}}}}};
  return {{"anyOf", {each_with_each, {{"type", "array"}, {"minItems", 1}, {"items", turn}}}}};
}

ordered step_schema(const StepKind& kind) {
  ordered options = kind.has_steps()          ? loop_schema()
                    : kind.takes_any_option() ? ordered{{"type", "object"}}
                                              : map_schema(kind.options());
  if (!options.contains("required") && !kind.has_steps())
    options = {{"anyOf", {options, {{"type", "null"}}}}};
  options["description"] = kind.about();
  ordered schema = {
      {"type", "object"},
      {"properties",
       {{kind.name(), options},
        {"name", {{"type", "string"}, {"description", "what captures and reports call the step"}}}}},
      {"required", {kind.name()}},
      {"additionalProperties", false}};
  if (kind.has_steps()) {
    schema["properties"]["steps"] = {{"$ref", "#/definitions/steps"}};
    schema["required"].push_back("steps");
  }
  return schema;
}

}  // namespace

std::string procedure_schema() {
  ordered steps = ordered::array();
  ordered bare = ordered::array();
  for (const auto& kind : step_kinds()) {
    steps.push_back(step_schema(*kind));
    const bool needs_nothing = std::ranges::none_of(kind->options(), &Option::required) && !kind->has_steps();
    if (needs_nothing) bare.push_back(kind->name());
  }
  steps.push_back({{"enum", bare}});
  const auto text = [](const char* about) { return ordered{{"type", "string"}, {"description", about}}; };
  ordered schema = {
      {"$schema", "http://json-schema.org/draft-07/schema#"},
      {"title", "Procedure of the calibration rig"},
      {"type", "object"},
      {"additionalProperties", false},
      {"required", {"procedure", "steps"}},
      {"properties",
       {{"procedure", text("its name, in files and reports")},
        {"version",
         {{"type", {"string", "number"}}, {"description", "of this procedure, printed on certificates"}}},
        {"title", text("what people call it")},
        {"about", text("what it is for")},
        {"source", text("paper, experiment or standard that it follows")},
        {"stage", map_schema(stage_options())},
        {"variables",
         {{"type", "object"},
          {"additionalProperties", {{"type", {"number", "string", "boolean"}}}},
          {"description", "numbers, texts and flags that expressions use; --set replaces one for a run"}}},
        {"limits", {{"type", "array"}, {"items", map_schema(limit_options())}}},
        {"steps", {{"$ref", "#/definitions/steps"}}}}},
      {"definitions", {{"steps", {{"type", "array"}, {"minItems", 1}, {"items", {{"anyOf", steps}}}}}}}};
  return schema.dump(2) + "\n";
}

}  // namespace rig
