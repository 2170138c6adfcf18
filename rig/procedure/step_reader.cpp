// SPDX-License-Identifier: MIT
#include "rig/procedure/step_reader.hpp"

#include "rig/procedure/option_check.hpp"
#include "rig/procedure/procedure_head.hpp"
#include "rig/procedure/step.hpp"

namespace rig {
namespace {

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
      throw ProcedureError(node.position,
                           "'steps' must be a list with at least one step, each starting with '- '.");
    std::vector<Step> steps;
    for (std::size_t i = 0; i < node.items.size(); ++i)
      steps.push_back(step(node.items[i], prefix + std::to_string(i + 1)));
    return steps;
  }

 private:
  Step step(const Node& node, const std::string& ordinal) {
    Step result;
    result.position = node.position;
    result.ordinal = ordinal;
    if (node.kind == Node::Kind::scalar) {  // "- home"
      result.kind = kind_of(node);
      result.options.kind = Node::Kind::map;
      result.options.position = node.position;
    } else if (node.kind == Node::Kind::map) {
      read_members(node, result);
    } else {
      throw ProcedureError(node.position, "a step is written '- KIND: {options}' with KIND one of " +
                                              listed(kind_names()) + ".");
    }
    check(result);
    return result;
  }

  const StepKind* kind_of(const Node& word) const {
    for (const auto& kind : step_kinds())
      if (kind->name() == word.scalar) return kind.get();
    const std::string meant = did_you_mean(word.scalar, kind_names());
    throw ProcedureError(word.position, "there is no step '" + word.scalar + "'; " +
                                            (meant.empty() ? "there are " + listed(kind_names()) + "."
                                                           : "did you mean '" + meant + "'?"));
  }

  void read_members(const Node& node, Step& result) {
    for (const auto& [key, value] : node.members) {
      if (key.scalar == "name") {
        if (value.kind != Node::Kind::scalar) throw ProcedureError(value.position, "'name' must be a text.");
        result.name = value.scalar;
      } else if (key.scalar != "steps") {
        if (result.kind)
          throw ProcedureError(key.position, "a step has one kind; '" + key.scalar + "' after '" +
                                                 result.kind->name() +
                                                 "' needs a '- ' of its own, or more indentation.");
        result.kind = kind_of(key);
        result.options = value;
      }
    }
    if (!result.kind)
      throw ProcedureError(node.position, "this step lacks its kind, one of " + listed(kind_names()) + ".");
    if (result.options.kind == Node::Kind::nothing) result.options.kind = Node::Kind::map;
    const bool turns = result.kind->has_steps() && result.options.kind == Node::Kind::list;
    if (result.options.kind != Node::Kind::map && !turns)
      throw ProcedureError(result.options.position,
                           "the options of '" + result.kind->name() + "' must be a map {key: value}.");
    read_inner_steps(node, result);
  }

  void read_inner_steps(const Node& node, Step& result) {
    const Node* inner = node.find("steps");
    if (!result.kind->has_steps()) {
      if (inner) throw ProcedureError(inner->position, "'" + result.kind->name() + "' takes no steps.");
      return;
    }
    if (!inner)
      throw ProcedureError(node.position, "'" + result.kind->name() + "' needs 'steps', beside it.");
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
          throw ProcedureError(value.position, "'" + key.scalar + "' must be one number or text.");
        (void)evaluated(value, variables_);
      }
    } else if (!step.kind->has_steps())
      check_map(step.options, step.kind->options(), "'" + step.kind->name() + "'", variables_);
    if (!step.name.empty()) {
      Node name;
      name.kind = Node::Kind::scalar;
      name.scalar = step.name;
      name.position = step.position;
      (void)evaluated(name, variables_);
    }
    for (const auto& name : step.kind->defines(step.options)) {
      if (!is_variable_name(name))
        throw ProcedureError(step.position,
                             "'" + name + "' cannot be a variable's name; use letters, digits and _.");
      variables_[name] = Unknown{};
    }
  }

  Variables variables_;
};

}  // namespace

std::vector<Step> read_steps(const Node& node, const Variables& variables) {
  return StepReader(variables).list(node, "");
}

}  // namespace rig
