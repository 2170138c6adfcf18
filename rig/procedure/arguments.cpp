// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "rig/procedure/option_check.hpp"

namespace rig {

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
  if (own.type == Option::Type::numbers) own.type = Option::Type::number;
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
  if (!found) throw ProcedureError(position(), "'" + name + "' is missing.");
  return *found;
}

double Arguments::number_or(const std::string& name, double otherwise) const {
  return maybe_number(name).value_or(otherwise);
}

int Arguments::integer_or(const std::string& name, int otherwise) const {
  const auto found = maybe_number(name);
  if (!found || std::isnan(*found)) return otherwise;
  if (std::abs(*found) > 2e9) throw ProcedureError(position_of(name), "'" + name + "' is too large.");
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
    throw ProcedureError(node->position, "'" + name + "' must ascend: [" + to_text(low) + ", " +
                                             to_text(high) + "] is the wrong way round.");
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

const FilePosition& Arguments::position_of(const std::string& name) const {
  const Node* node = options_->find(name);
  return node ? node->position : options_->position;
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

}  // namespace rig
