// SPDX-License-Identifier: MIT
#include "rig/runner/granted_targets.hpp"

#include <algorithm>
#include <iterator>

namespace rig {
namespace {

/// The text of a step's option with the variables of its turn; empty if it has none.
std::string option_text(const Node& options, const std::string& name, const Variables& variables) {
  const Node* node = options.find(name);
  if (!node || node->kind != Node::Kind::scalar) return "";
  try {
    return to_text(evaluate_text(node->scalar, variables));
  } catch (const ExpressionError&) {  // It uses what only the run will know.
    return "";
  }
}

}  // namespace

std::set<std::string> taken_for_granted(const std::vector<PlannedStep>& plan, const Variables& variables,
                                        const fit::Bench& bench) {
  std::set<std::string> used, placed;
  for (const PlannedStep& step : plan) {
    Variables all = variables;
    for (const auto& [name, value] : step.loop_variables) all[name] = value;
    const StepKind& kind = *step.step->kind;
    if (kind.measures()) {
      const std::string target = option_text(step.step->options, "target", all);
      if (!target.empty()) used.insert(target);
      if (target.empty())
        for (const fit::Target& each : bench.targets) used.insert(each.name);
    } else if (const Node* place = kind.places(step.step->options)) {
      placed.insert(option_text(*place, "target", all));
    }
  }
  std::set<std::string> granted;
  std::ranges::set_difference(used, placed, std::inserter(granted, granted.end()));
  return granted;
}

}  // namespace rig
