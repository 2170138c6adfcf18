// SPDX-License-Identifier: MIT
#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

class Set final : public StepKind {
 public:
  std::string name() const override { return "set"; }
  std::string about() const override { return "Gives variables their values: {name: value, ...}"; }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> any;
    return any;
  }
  bool takes_any_option() const override { return true; }
  std::vector<std::string> defines(const Node& options) const override {
    std::vector<std::string> names;
    for (const auto& [key, value] : options.members) names.push_back(key.scalar);
    return names;
  }
  void plan(const Arguments& arguments, Plan& plan) const override {
    for (const auto& [key, value] : arguments.node().members) {
      plan.variables[key.scalar] = arguments.value(value);
      plan.says +=
          (plan.says.empty() ? "set " : ", ") + key.scalar + " = " + to_text(plan.variables[key.scalar]);
    }
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    for (const auto& [key, value] : arguments.node().members) context.set(key.scalar, arguments.value(value));
    co_return;
  }
};

}  // namespace

std::unique_ptr<StepKind> make_set();
std::unique_ptr<StepKind> make_set() { return std::make_unique<Set>(); }

}  // namespace rig::steps
