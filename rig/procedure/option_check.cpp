// SPDX-License-Identifier: MIT
#include "rig/procedure/option_check.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace rig {
namespace {

using Type = Option::Type;

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
      return "one of " + listed(option.choices);
    case Type::path:
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

}  // namespace

void refuse_key(const Node& key, const std::string& of, const std::vector<std::string>& known) {
  const std::string meant = did_you_mean(key.scalar, known);
  throw ProcedureError(key.position, of + " has no option '" + key.scalar + "'; " +
                                         (meant.empty() ? "it takes " + listed(known) + "."
                                                        : "did you mean '" + meant + "'?"));
}

void refuse_value(const Node& node, const Option& option, const std::string& got) {
  throw ProcedureError(node.position, "'" + option.name + "' must be " + expected(option) + ", not '" + got +
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
    FilePosition position = node.position;
    if (node.scalar.find('\n') == std::string::npos) position.column += static_cast<int>(error.offset);
    throw ProcedureError(position, std::string(error.what()) + ".");
  }
}

namespace {

/// A file name that stays in the output folder.
void check_output_name(const Node& node, const Option& option, const std::string& name) {
  const std::filesystem::path path(name);
  bool leaves = name.empty() || path.is_absolute();
  for (const auto& part : path) leaves |= part == "..";
  if (leaves)
    throw ProcedureError(node.position, "'" + option.name +
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
        throw ProcedureError(node.position, "'" + option.name + "' must be " + expected(option) + ", not '" +
                                                to_text(value) + "'." +
                                                (meant.empty() ? "" : " Did you mean '" + meant + "'?"));
      }
      return;
    case Type::path:
      return check_output_name(node, option, to_text(value));
    default:
      return;
  }
}

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

}  // namespace

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
      throw ProcedureError(node.position, of + " needs '" + option.name + "': " + option.about + ".");
}

}  // namespace rig
