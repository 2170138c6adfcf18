// SPDX-License-Identifier: MIT
#include "rig/procedure/procedure_head.hpp"

#include <algorithm>

#include "rig/procedure/option_check.hpp"
#include "rig/procedure/step.hpp"

namespace rig {

const std::vector<Option>& stage_options() {
  static const std::vector<Option> options = {
      approach_option(),
      {.name = "margin_deg",
       .about = "run-up before every stop, more than the stage's backlash",
       .min = 0,
       .max = 20},
      {.name = "tolerance_deg",
       .about = "largest difference between command and read-back",
       .min = 0.0001,
       .max = 10},
      {.name = "settle_s", .about = "extra wait after the stage has stopped", .min = 0, .max = 600},
      {.name = "unhomed", .type = Option::Type::flag, .about = "moving before homing is allowed"}};
  return options;
}

const std::vector<Option>& limit_options() {
  static const std::vector<Option> options = {
      {.name = "name", .type = Option::Type::text, .about = "what the report calls it", .required = true},
      {.name = "of",
       .type = Option::Type::text,
       .about = "the result's value, as KIND.VALUE (centre.centre_x_mm)",
       .required = true},
      {.name = "min", .about = "smallest allowed value"},
      {.name = "max", .about = "largest allowed value"},
      {.name = "max_expanded", .about = "largest allowed expanded uncertainty (k = 2)", .min = 0},
      {.name = "guard_band",
       .type = Option::Type::text,
       .about =
           "'expanded' for a guard band as wide as the expanded uncertainty, or a width; none by default"}};
  return options;
}

const std::vector<std::string>& top_keys() {
  static const std::vector<std::string> keys = {"procedure", "version",   "title",  "about", "source",
                                                "stage",     "variables", "limits", "steps"};
  return keys;
}

StageRules read_stage(const Node& node, const Variables& variables) {
  check_map(node, stage_options(), "'stage'", variables);
  const Arguments arguments(node, stage_options(), variables);
  StageRules rules;
  rules.approach = approach_of(arguments, rules.approach);
  rules.margin_deg = arguments.number_or("margin_deg", rules.margin_deg);
  rules.tolerance_deg = arguments.number_or("tolerance_deg", rules.tolerance_deg);
  rules.settle_s = arguments.number_or("settle_s", rules.settle_s);
  rules.unhomed = arguments.flag_or("unhomed", rules.unhomed);
  return rules;
}

Limit read_limit(const Node& node, const Variables& variables) {
  if (node.kind != Node::Kind::map)
    throw ProcedureError(node.position, "a limit must be a map {name: ..., of: ...}.");
  check_map(node, limit_options(), "a limit", variables);
  const Arguments arguments(node, limit_options(), variables);
  Limit limit;
  limit.name = arguments.text_or("name", "");
  const std::string of = arguments.text_or("of", "");
  const auto dot = of.find('.');
  if (dot == std::string::npos || dot == 0 || dot + 1 == of.size())
    throw ProcedureError(arguments.position_of("of"),
                         "'of' must be KIND.VALUE, as in centre.centre_x_mm, not '" + of + "'.");
  limit.position = arguments.position_of("of");
  limit.kind = of.substr(0, dot);
  limit.value = of.substr(dot + 1);
  limit.min = arguments.maybe_number("min");
  limit.max = arguments.maybe_number("max");
  limit.max_expanded = arguments.maybe_number("max_expanded");
  if (!limit.min && !limit.max && !limit.max_expanded)
    throw ProcedureError(node.position,
                         "the limit '" + limit.name + "' limits nothing; give min, max or max_expanded.");
  const Value guard = value_of_text(arguments.text_or("guard_band", "0"));
  limit.guarded = to_text(guard) == "expanded";
  if (const auto* width = std::get_if<double>(&guard); width && *width >= 0)
    limit.guard_band = *width;
  else if (!limit.guarded)
    throw ProcedureError(arguments.position_of("guard_band"),
                         "'guard_band' must be 'expanded' or a width, not '" + to_text(guard) + "'.");
  if (limit.min && limit.max && *limit.max - *limit.min < 2 * limit.guard_band)
    throw ProcedureError(arguments.position_of("max"),
                         "the limit '" + limit.name + "' allows no value: min " + to_text(*limit.min) +
                             " and max " + to_text(*limit.max) +
                             (*limit.max < *limit.min ? " are the wrong way round."
                                                      : " leave none between their guard bands."));
  return limit;
}

bool is_variable_name(const std::string& name) {
  if (name.empty() || name.size() > 64 || (name[0] >= '0' && name[0] <= '9')) return false;
  return std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  });
}

namespace {

/// A variable given on the command line has the type of the procedure's own.
Value instead_of(const Value& own, const std::string& name, const Value& given) {
  const bool fits = own.index() == given.index() || std::holds_alternative<std::string>(own);
  if (fits || std::holds_alternative<Unknown>(own)) return given;
  const std::string wanted = std::holds_alternative<bool>(own) ? "true or false" : "a number";
  throw UsageError("--set " + name + "=" + to_text(given) + ": '" + name + "' must be " + wanted + ", not '" +
                   to_text(given) + "'. The procedure's own is " + name + "=" + to_text(own) + ".");
}

}  // namespace

Variables read_variables(const Node& node, const Variables& overrides) {
  Variables variables;
  for (const auto& [key, value] : node.members) {
    if (!is_variable_name(key.scalar))
      throw ProcedureError(key.position,
                           "'" + key.scalar + "' cannot be a variable's name; use letters, digits and _.");
    if (value.kind != Node::Kind::scalar)
      throw ProcedureError(value.position,
                           "a variable holds one number, text or true/false; lists stand in for-each.");
    const Value own = evaluated(value, variables);
    const auto given = overrides.find(key.scalar);
    variables[key.scalar] = given == overrides.end() ? own : instead_of(own, key.scalar, given->second);
  }
  for (const auto& [name, value] : overrides)
    if (!variables.count(name)) {
      std::vector<std::string> names;
      for (const auto& [known, each] : variables) names.push_back(known);
      const std::string meant = did_you_mean(name, names);
      throw UsageError("--set " + name + "=" + to_text(value) + ": " + node.position.file +
                       " has no variable '" + name + "'" +
                       (meant.empty() ? (names.empty() ? "." : "; it has " + listed(names) + ".")
                                      : "; did you mean '" + meant + "'?"));
    }
  return variables;
}

}  // namespace rig
