// SPDX-License-Identifier: MIT
#include "rig/procedure/procedure.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "rig/procedure/step.hpp"

namespace rig {
namespace {

constexpr std::size_t largest_file_bytes = 1 << 20;
constexpr std::size_t most_nodes =
    20'000;  // Aliases of aliases grow without bound; no procedure needs this many.
constexpr int deepest_nesting = 40;

using Type = Option::Type;

Place place_of(const YAML::Mark& mark, const std::string& file) {
  return {file, mark.line + 1, mark.column + 1};
}

/// Copies the parsed document into our own tree, with bounds on its size.
class Copier {
 public:
  explicit Copier(const std::string& file) : file_(file) {}

  Node copy(const YAML::Node& from, int depth = 0) {
    Node node;
    node.place = place_of(from.Mark(), file_);
    if (++nodes_ > most_nodes || depth > deepest_nesting)
      throw ProcedureError(node.place,
                           "the file is nested too deeply or repeats itself through aliases; write it out "
                           "in fewer levels.");
    if (from.IsScalar()) {
      node.kind = Node::Kind::scalar;
      node.scalar = from.Scalar();
    } else if (from.IsSequence()) {
      node.kind = Node::Kind::list;
      for (const auto& item : from) node.items.push_back(copy(item, depth + 1));
    } else if (from.IsMap()) {
      node.kind = Node::Kind::map;
      copy_members(from, node, depth);
    }
    return node;
  }

 private:
  void copy_members(const YAML::Node& from, Node& node, int depth) {
    std::set<std::string> seen;
    for (const auto& member : from) {
      Node key = copy(member.first, depth + 1);
      if (key.kind != Node::Kind::scalar) throw ProcedureError(key.place, "a key must be a plain word.");
      if (!seen.insert(key.scalar).second)
        throw ProcedureError(key.place, "'" + key.scalar + "' is given twice; remove one.");
      node.members.push_back({std::move(key), copy(member.second, depth + 1)});
    }
  }

  const std::string& file_;
  std::size_t nodes_ = 0;
};

std::string quoted_list(const std::vector<std::string>& words) {
  std::string text;
  for (const auto& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

[[noreturn]] void refuse_key(const Node& key, const std::string& of, const std::vector<std::string>& known) {
  const std::string meant = did_you_mean(key.scalar, known);
  throw ProcedureError(key.place, of + " has no option '" + key.scalar + "'; " +
                                      (meant.empty() ? "it takes " + quoted_list(known) + "."
                                                     : "did you mean '" + meant + "'?"));
}

std::string range_text(const Option& option) {
  std::string text;
  if (option.min) text += " of at least " + to_text(*option.min);
  if (option.max) text += std::string(option.min ? " and" : " of") + " at most " + to_text(*option.max);
  return text;
}

std::string expected(const Option& option) {
  switch (option.type) {
    case Type::number:
      return "a number" + range_text(option);
    case Type::integer:
      return "a whole number" + range_text(option);
    case Type::text:
      return "a text";
    case Type::flag:
      return "true or false";
    case Type::numbers:
      return "two numbers in brackets, [from, to]";
    case Type::map:
      return "a map {key: value}";
    case Type::choice:
      return "one of " + quoted_list(option.choices);
    case Type::place:
      return "a file name";
  }
  return "";
}

/// Where a value that was not written there comes from.
std::string origin_of(const Node& node) {
  if (!has_expression(node.scalar)) return "";
  return " That is what " + node.scalar +
         " gives; correct the variables there, or --set on the command line.";
}

[[noreturn]] void refuse_value(const Node& node, const Option& option, const std::string& got) {
  throw ProcedureError(node.place, "'" + option.name + "' must be " + expected(option) + ", not '" + got +
                                       "'." + origin_of(node));
}

void check_in_range(const Node& node, const Option& option, double number) {
  if (std::isnan(number)) return;
  if (option.type == Type::integer && number != std::floor(number))
    refuse_value(node, option, to_text(number));
  if ((option.min && number < *option.min) || (option.max && number > *option.max))
    refuse_value(node, option, to_text(number));
}

Value evaluated(const Node& node, const Variables& variables) {
  try {
    return evaluate_text(node.scalar, variables);
  } catch (const ExpressionError& error) {
    Place place = node.place;
    if (node.scalar.find('\n') == std::string::npos) place.column += static_cast<int>(error.offset);
    throw ProcedureError(place, std::string(error.what()) + ".");
  }
}

/// A file name that stays in the output folder.
void check_output_name(const Node& node, const Option& option, const std::string& name) {
  const std::filesystem::path path(name);
  bool leaves = name.empty() || path.is_absolute();
  for (const auto& part : path) leaves |= part == "..";
  if (leaves)
    throw ProcedureError(node.place, "'" + option.name +
                                         "' must name a file inside the output folder, not '" + name +
                                         "'. Give a relative name without '..'.");
}

void check_scalar(const Node& node, const Option& option, const Variables& variables) {
  const Value value = evaluated(node, variables);
  if (std::holds_alternative<Unknown>(value)) return;
  const auto* number = std::get_if<double>(&value);
  switch (option.type) {
    case Type::number:
    case Type::integer:
      if (!number) refuse_value(node, option, to_text(value));
      return check_in_range(node, option, *number);
    case Type::flag:
      if (!std::holds_alternative<bool>(value)) refuse_value(node, option, to_text(value));
      return;
    case Type::choice:
      if (std::ranges::find(option.choices, to_text(value)) == option.choices.end()) {
        const std::string meant = did_you_mean(to_text(value), option.choices);
        throw ProcedureError(node.place, "'" + option.name + "' must be " + expected(option) + ", not '" +
                                             to_text(value) + "'." +
                                             (meant.empty() ? "" : " Did you mean '" + meant + "'?"));
      }
      return;
    case Type::place:
      return check_output_name(node, option, to_text(value));
    default:
      return;
  }
}

void check_map(const Node& node, const std::vector<Option>& known, const std::string& of,
               const Variables& variables);

void check_value(const Node& node, const Option& option, const Variables& variables) {
  switch (option.type) {
    case Type::numbers: {
      if (node.kind != Node::Kind::list || node.items.size() != 2) refuse_value(node, option, node.scalar);
      Option each = option;
      each.type = Type::number;
      for (const Node& item : node.items) {
        if (item.kind != Node::Kind::scalar) refuse_value(item, each, "a list");
        check_scalar(item, each, variables);
      }
      return;
    }
    case Type::map:
      if (node.kind != Node::Kind::map) refuse_value(node, option, node.scalar);
      if (!option.members.empty()) check_map(node, option.members, "'" + option.name + "'", variables);
      return;
    default:
      if (node.kind != Node::Kind::scalar)
        refuse_value(node, option, node.kind == Node::Kind::nothing ? "nothing" : "a list or map");
      return check_scalar(node, option, variables);
  }
}

void check_map(const Node& node, const std::vector<Option>& known, const std::string& of,
               const Variables& variables) {
  for (const auto& [key, value] : node.members) {
    const auto option = std::ranges::find(known, key.scalar, &Option::name);
    if (option == known.end()) {
      std::vector<std::string> names;
      for (const auto& each : known) names.push_back(each.name);
      refuse_key(key, of, names);
    }
    check_value(value, *option, variables);
  }
  for (const auto& option : known)
    if (option.required && !node.find(option.name))
      throw ProcedureError(node.place, of + " needs '" + option.name + "': " + option.about + ".");
}

// --- the file's own top level
// ----------------------------------------------------------------------------------

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
      {.name = "settle_s", .about = "extra wait after the stage stands", .min = 0, .max = 600},
      {.name = "unhomed", .type = Type::flag, .about = "moving before homing is allowed"}};
  return options;
}

const std::vector<Option>& limit_options() {
  static const std::vector<Option> options = {
      {.name = "name", .type = Type::text, .about = "what the report calls it", .required = true},
      {.name = "of",
       .type = Type::text,
       .about = "the result's value, as KIND.VALUE (centre.x_mm)",
       .required = true},
      {.name = "min", .about = "smallest allowed value"},
      {.name = "max", .about = "largest allowed value"},
      {.name = "max_expanded", .about = "largest allowed expanded uncertainty (k = 2)", .min = 0},
      {.name = "guard_band",
       .type = Type::text,
       .about =
           "'expanded' for a guard band as wide as the expanded uncertainty, or a width; none by default"}};
  return options;
}

const std::vector<std::string>& top_keys() {
  static const std::vector<std::string> keys = {"procedure", "title",     "about",  "source",
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
    throw ProcedureError(node.place, "a limit must be a map {name: ..., of: ...}.");
  check_map(node, limit_options(), "a limit", variables);
  const Arguments arguments(node, limit_options(), variables);
  Limit limit;
  limit.name = arguments.text_or("name", "");
  const std::string of = arguments.text_or("of", "");
  const auto dot = of.find('.');
  if (dot == std::string::npos || dot == 0 || dot + 1 == of.size())
    throw ProcedureError(arguments.place_of("of"),
                         "'of' must be KIND.VALUE, as in centre.x_mm, not '" + of + "'.");
  limit.kind = of.substr(0, dot);
  limit.value = of.substr(dot + 1);
  limit.min = arguments.maybe_number("min");
  limit.max = arguments.maybe_number("max");
  limit.max_expanded = arguments.maybe_number("max_expanded");
  if (!limit.min && !limit.max && !limit.max_expanded)
    throw ProcedureError(node.place,
                         "the limit '" + limit.name + "' limits nothing; give min, max or max_expanded.");
  const Value guard = value_of_text(arguments.text_or("guard_band", "0"));
  limit.guarded = to_text(guard) == "expanded";
  if (const auto* width = std::get_if<double>(&guard); width && *width >= 0)
    limit.guard_band = *width;
  else if (!limit.guarded)
    throw ProcedureError(arguments.place_of("guard_band"),
                         "'guard_band' must be 'expanded' or a width, not '" + to_text(guard) + "'.");
  return limit;
}

bool is_variable_name(const std::string& name) {
  if (name.empty() || name.size() > 64 || (name[0] >= '0' && name[0] <= '9')) return false;
  return std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  });
}

/// A variable given on the command line has the type of the procedure's own.
Value instead_of(const Value& own, const std::string& name, const Value& given) {
  const bool fits = own.index() == given.index() || std::holds_alternative<std::string>(own);
  if (fits || std::holds_alternative<Unknown>(own)) return given;
  const std::string wanted = std::holds_alternative<bool>(own) ? "true or false" : "a number";
  throw UsageError("--set " + name + "=" + to_text(given) + ": '" + name + "' must be " + wanted + ", not '" +
                   to_text(given) + "'. The procedure's own is " + name + "=" + to_text(own) + ".");
}

Variables read_variables(const Node& node, const Variables& overrides) {
  Variables variables;
  for (const auto& [key, value] : node.members) {
    if (!is_variable_name(key.scalar))
      throw ProcedureError(key.place,
                           "'" + key.scalar + "' cannot be a variable's name; use letters, digits and _.");
    if (value.kind != Node::Kind::scalar)
      throw ProcedureError(value.place,
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
      throw UsageError("--set " + name + "=" + to_text(value) + ": " + node.place.file +
                       " has no variable '" + name + "'" +
                       (meant.empty() ? (names.empty() ? "." : "; it has " + quoted_list(names) + ".")
                                      : "; did you mean '" + meant + "'?"));
    }
  return variables;
}

// --- steps
// -----------------------------------------------------------------------------------------------------

std::vector<std::string> kind_names() {
  std::vector<std::string> names;
  for (const auto& kind : step_kinds()) names.push_back(kind->name());
  return names;
}

/// Reads steps in order, so that each may use the variables that those before it define.
class StepReader {
 public:
  explicit StepReader(Variables variables) : variables_(std::move(variables)) {}

  std::vector<Step> list(const Node& node, const std::string& prefix) {
    if (node.kind != Node::Kind::list || node.items.empty())
      throw ProcedureError(node.place,
                           "'steps' must be a list with at least one step, each starting with '- '.");
    std::vector<Step> steps;
    for (std::size_t i = 0; i < node.items.size(); ++i)
      steps.push_back(step(node.items[i], prefix + std::to_string(i + 1)));
    return steps;
  }

 private:
  Step step(const Node& node, const std::string& ordinal) {
    Step result;
    result.place = node.place;
    result.ordinal = ordinal;
    if (node.kind == Node::Kind::scalar) {  // "- home"
      result.kind = kind_of(node);
      result.options.kind = Node::Kind::map;
      result.options.place = node.place;
    } else if (node.kind == Node::Kind::map) {
      read_members(node, result);
    } else {
      throw ProcedureError(node.place, "a step is written '- KIND: {options}' with KIND one of " +
                                           quoted_list(kind_names()) + ".");
    }
    check(result);
    return result;
  }

  const StepKind* kind_of(const Node& word) const {
    for (const auto& kind : step_kinds())
      if (kind->name() == word.scalar) return kind.get();
    const std::string meant = did_you_mean(word.scalar, kind_names());
    throw ProcedureError(word.place, "there is no step '" + word.scalar + "'; " +
                                         (meant.empty() ? "there are " + quoted_list(kind_names()) + "."
                                                        : "did you mean '" + meant + "'?"));
  }

  void read_members(const Node& node, Step& result) {
    for (const auto& [key, value] : node.members) {
      if (key.scalar == "name") {
        if (value.kind != Node::Kind::scalar) throw ProcedureError(value.place, "'name' must be a text.");
        result.name = value.scalar;
      } else if (key.scalar != "steps") {
        if (result.kind)
          throw ProcedureError(key.place, "a step has one kind; '" + key.scalar + "' after '" +
                                              result.kind->name() +
                                              "' needs a '- ' of its own, or more indentation.");
        result.kind = kind_of(key);
        result.options = value;
      }
    }
    if (!result.kind)
      throw ProcedureError(node.place, "this step lacks its kind, one of " + quoted_list(kind_names()) + ".");
    if (result.options.kind == Node::Kind::nothing) result.options.kind = Node::Kind::map;
    if (result.options.kind != Node::Kind::map)
      throw ProcedureError(result.options.place,
                           "the options of '" + result.kind->name() + "' must be a map {key: value}.");
    read_inner_steps(node, result);
  }

  void read_inner_steps(const Node& node, Step& result) {
    const Node* inner = node.find("steps");
    if (!result.kind->has_steps()) {
      if (inner) throw ProcedureError(inner->place, "'" + result.kind->name() + "' takes no steps.");
      return;
    }
    if (!inner) throw ProcedureError(node.place, "'" + result.kind->name() + "' needs 'steps', beside it.");
    const Variables outer = variables_;
    const auto turns = iterations(result.options, variables_);
    std::vector<std::string> own;
    for (const auto& [name, value] : turns.front()) {
      own.push_back(name);
      // One value alone is known; of several, each turn is checked when the plan is made.
      variables_[name] = turns.size() == 1 ? value : Value(Unknown{});
    }
    result.steps = list(*inner, result.ordinal + ".");
    for (const auto& name : own) {
      variables_.erase(name);
      if (outer.count(name)) variables_[name] = outer.at(name);
    }
  }

  void check(const Step& step) {
    if (step.kind->takes_any_option()) {
      for (const auto& [key, value] : step.options.members) {
        if (value.kind != Node::Kind::scalar)
          throw ProcedureError(value.place, "'" + key.scalar + "' must be one number or text.");
        (void)evaluated(value, variables_);
      }
    } else if (!step.kind->has_steps())
      check_map(step.options, step.kind->options(), "'" + step.kind->name() + "'", variables_);
    if (!step.name.empty()) {
      Node name;
      name.kind = Node::Kind::scalar;
      name.scalar = step.name;
      name.place = step.place;
      (void)evaluated(name, variables_);
    }
    for (const auto& name : step.kind->defines(step.options)) {
      if (!is_variable_name(name))
        throw ProcedureError(step.place,
                             "'" + name + "' cannot be a variable's name; use letters, digits and _.");
      variables_[name] = Unknown{};
    }
  }

  Variables variables_;
};

Procedure read_document(const Node& root, const Variables& overrides) {
  Procedure procedure;
  if (root.kind != Node::Kind::map)
    throw ProcedureError(root.place,
                         "a procedure file is a map with the keys " + quoted_list(top_keys()) + ".");
  for (const auto& [key, value] : root.members)
    if (std::ranges::find(top_keys(), key.scalar) == top_keys().end())
      refuse_key(key, "a procedure file", top_keys());
  const auto text = [&](const char* key, bool required) -> std::string {
    const Node* node = root.find(key);
    if (!node && required)
      throw ProcedureError(root.place, std::string("'") + key + "' is missing: give the procedure a name.");
    if (node && node->kind != Node::Kind::scalar)
      throw ProcedureError(node->place, std::string("'") + key + "' must be a text.");
    return node ? node->scalar : "";
  };
  procedure.name = text("procedure", true);
  procedure.title = text("title", false);
  procedure.about = text("about", false);
  procedure.source = text("source", false);
  if (procedure.title.empty()) procedure.title = procedure.name;
  Node nothing;
  nothing.place = root.place;
  const Node* variables = root.find("variables");
  if (variables && variables->kind != Node::Kind::map && variables->kind != Node::Kind::nothing)
    throw ProcedureError(variables->place, "'variables' must be a map {name: value}.");
  procedure.variables = read_variables(variables ? *variables : nothing, overrides);
  if (const Node* stage = root.find("stage")) procedure.stage = read_stage(*stage, procedure.variables);
  if (const Node* limits = root.find("limits")) {
    if (limits->kind != Node::Kind::list) throw ProcedureError(limits->place, "'limits' must be a list.");
    for (const Node& limit : limits->items)
      procedure.limits.push_back(read_limit(limit, procedure.variables));
  }
  const Node* steps = root.find("steps");
  if (!steps) throw ProcedureError(root.place, "'steps' is missing: a procedure needs at least one step.");
  procedure.steps = StepReader(procedure.variables).list(*steps, "");
  return procedure;
}

}  // namespace

std::string Place::text() const { return file + ":" + std::to_string(line) + ":" + std::to_string(column); }

const Node* Node::find(const std::string& key) const {
  for (const auto& [name, value] : members)
    if (name.scalar == key) return &value;
  return nullptr;
}

const Option* Arguments::option(const std::string& name) const {
  const auto found = std::ranges::find(*known_, name, &Option::name);
  return found == known_->end() ? nullptr : &*found;
}

Value Arguments::value(const Node& scalar) const { return evaluated(scalar, *variables_); }

double Arguments::checked_number(const Node& scalar, const std::string& name) const {
  const Value result = evaluated(scalar, *variables_);
  if (std::holds_alternative<Unknown>(result)) return std::numeric_limits<double>::quiet_NaN();
  Option fallback;
  fallback.name = name;
  Option own = option(name) ? *option(name) : fallback;
  if (own.type == Type::numbers) own.type = Type::number;
  const auto* number = std::get_if<double>(&result);
  if (!number) refuse_value(scalar, own, to_text(result));
  check_in_range(scalar, own, *number);
  return *number;
}

std::optional<double> Arguments::maybe_number(const std::string& name) const {
  const Node* node = options_->find(name);
  if (!node) return std::nullopt;
  return checked_number(*node, name);
}

double Arguments::number(const std::string& name) const {
  const auto found = maybe_number(name);
  if (!found) throw ProcedureError(place(), "'" + name + "' is missing.");
  return *found;
}

double Arguments::number_or(const std::string& name, double otherwise) const {
  return maybe_number(name).value_or(otherwise);
}

int Arguments::integer_or(const std::string& name, int otherwise) const {
  const auto found = maybe_number(name);
  if (!found || std::isnan(*found)) return otherwise;
  if (std::abs(*found) > 2e9) throw ProcedureError(place_of(name), "'" + name + "' is too large.");
  return static_cast<int>(*found);
}

std::string Arguments::text_or(const std::string& name, const std::string& otherwise) const {
  const Node* node = options_->find(name);
  if (!node) return otherwise;
  const Value result = evaluated(*node, *variables_);
  return to_text(result);
}

bool Arguments::flag_or(const std::string& name, bool otherwise) const {
  const Node* node = options_->find(name);
  if (!node) return otherwise;
  const Value result = evaluated(*node, *variables_);
  const auto* flag = std::get_if<bool>(&result);
  return flag ? *flag : otherwise;
}

std::optional<std::pair<double, double>> Arguments::interval(const std::string& name) const {
  const Node* node = options_->find(name);
  if (!node || node->items.size() != 2) return std::nullopt;
  const double low = checked_number(node->items[0], name), high = checked_number(node->items[1], name);
  if (low > high)
    throw ProcedureError(node->place, "'" + name + "' must ascend: [" + to_text(low) + ", " + to_text(high) +
                                          "] is the wrong way round.");
  return std::pair(low, high);
}

Arguments Arguments::map(const std::string& name) const {
  static const Node empty = [] {
    Node node;
    node.kind = Node::Kind::map;
    return node;
  }();
  const Node* node = options_->find(name);
  const Option* known = option(name);
  return Arguments(node ? *node : empty, known ? known->members : *known_, *variables_);
}

const Place& Arguments::place_of(const std::string& name) const {
  const Node* node = options_->find(name);
  return node ? node->place : options_->place;
}

namespace {

nlohmann::json json_of(const Node& node, const Variables& variables) {
  switch (node.kind) {
    case Node::Kind::nothing:
      return nullptr;
    case Node::Kind::list: {
      auto list = nlohmann::json::array();
      for (const Node& item : node.items) list.push_back(json_of(item, variables));
      return list;
    }
    case Node::Kind::map: {
      auto map = nlohmann::json::object();
      for (const auto& [key, value] : node.members) map[key.scalar] = json_of(value, variables);
      return map;
    }
    case Node::Kind::scalar:
      break;
  }
  const Value value = evaluated(node, variables);
  if (const auto* number = std::get_if<double>(&value)) {
    if (*number == std::floor(*number) && std::abs(*number) < 1e15) return static_cast<std::int64_t>(*number);
    return *number;
  }
  if (const auto* flag = std::get_if<bool>(&value)) return *flag;
  if (const auto* text = std::get_if<std::string>(&value)) return *text;
  return nullptr;
}

}  // namespace

nlohmann::json Arguments::json(const std::string& name) const {
  const Node* node = options_->find(name);
  return node ? json_of(*node, *variables_) : nlohmann::json::object();
}

Procedure parse_procedure(const std::string& text, const std::string& file, const Variables& overrides) {
  if (text.size() > largest_file_bytes)
    throw UsageError(file + " is larger than 1 MB, which no procedure is. Check that it is the right file.");
  Node root;
  try {
    root = Copier(file).copy(YAML::Load(text));
  } catch (const YAML::Exception& error) {
    throw ProcedureError(
        place_of(error.mark, file),
        "this is not YAML: " + error.msg + ". Check indentation, colons and brackets here and just above.");
  }
  root.place.file = file;
  if (root.place.line < 1) root.place.line = root.place.column = 1;
  Procedure procedure = read_document(root, overrides);
  procedure.file = file;
  procedure.text = text;
  return procedure;
}

Procedure read_procedure(const std::string& path, const Variables& overrides) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw UsageError(path + ": cannot be read. Check the name and its permissions.");
  std::string text(largest_file_bytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  return parse_procedure(text, path, overrides);
}

std::string find_procedure(const std::string& path_or_name) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (fs::is_regular_file(path_or_name, ignored)) return path_or_name;
  std::vector<fs::path> folders = {"procedures"};
  const fs::path program = fs::read_symlink("/proc/self/exe", ignored);
  if (!ignored)  // build/bin/rig in a source tree, or PREFIX/bin/rig
    for (const char* folder : {"procedures", "../procedures", "../../procedures", "../share/rig/procedures"})
      folders.push_back(program.parent_path() / folder);
  std::vector<std::string> names;
  for (const auto& folder : folders) {
    const fs::path candidate = folder / (path_or_name + ".yaml");
    if (path_or_name.find('/') == std::string::npos && fs::is_regular_file(candidate, ignored))
      return candidate.lexically_normal().string();
    for (fs::directory_iterator entry(folder, ignored), end; !ignored && entry != end;
         entry.increment(ignored))
      if (entry->path().extension() == ".yaml") names.push_back(entry->path().stem().string());
  }
  std::ranges::sort(names);
  names.erase(std::unique(names.begin(), names.end()), names.end());
  const std::string meant = did_you_mean(path_or_name, names);
  throw UsageError(
      "there is no procedure '" + path_or_name + "'" +
      (meant.empty() ? "" : "; did you mean '" + meant + "'?") +
      (names.empty() ? ". Give the path of a procedure file." : " Ready ones: " + quoted_list(names) + "."));
}

// --- the schema
// ------------------------------------------------------------------------------------------------

namespace {

using ordered = nlohmann::ordered_json;

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
    case Type::place:
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
  return {{"type", "object"},
          {"minProperties", 1},
          {"additionalProperties", {{"anyOf", {{{"type", "array"}, {"minItems", 1}}, range}}}}};
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
  const ordered text = {{"type", "string"}};
  ordered schema = {
      {"$schema", "http://json-schema.org/draft-07/schema#"},
      {"title", "Procedure of the calibration rig"},
      {"type", "object"},
      {"additionalProperties", false},
      {"required", {"procedure", "steps"}},
      {"properties",
       {{"procedure", text},
        {"title", text},
        {"about", text},
        {"source", text},
        {"stage", map_schema(stage_options())},
        {"variables",
         {{"type", "object"}, {"additionalProperties", {{"type", {"number", "string", "boolean"}}}}}},
        {"limits", {{"type", "array"}, {"items", map_schema(limit_options())}}},
        {"steps", {{"$ref", "#/definitions/steps"}}}}},
      {"definitions", {{"steps", {{"type", "array"}, {"minItems", 1}, {"items", {{"anyOf", steps}}}}}}}};
  return schema.dump(2) + "\n";
}

}  // namespace rig
