// SPDX-License-Identifier: MIT
#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

/// unroll() (procedure_plan.hpp) repeats its steps; this file only says that it exists.
class ForEach final : public StepKind {
 public:
  std::string name() const override { return "for-each"; }
  std::string about() const override {
    return "Repeats steps for every value of a variable (of several: for every combination), or for every "
           "entry of a list";
  }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> none;
    return none;
  }
  bool has_steps() const override { return true; }
  void plan(const Arguments&, Plan&) const override {}
  awaitable<void> run(const Arguments&, StepContext&) const override { co_return; }
};

}  // namespace

std::unique_ptr<StepKind> make_for_each();
std::unique_ptr<StepKind> make_for_each() { return std::make_unique<ForEach>(); }

}  // namespace rig::steps
