// SPDX-License-Identifier: MIT
#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

using Type = Option::Type;

class Home final : public StepKind {
 public:
  std::string name() const override { return "home"; }
  std::string about() const override {
    return "Finds the stage's reference; not repeated if the stage knows it already";
  }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = {
        {.name = "again", .type = Type::flag, .about = "home even if the stage says that it is homed"}};
    return options;
  }
  void plan(const Arguments&, Plan& plan) const override {
    plan.seconds += 180 / plan.limits.speed_deg_s;
    plan.homed = true;
    plan.stage_deg = 0;
    plan.says = "home the stage";
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    co_await context.home(arguments.flag_or("again", false));
  }
};

}  // namespace

std::unique_ptr<StepKind> make_home();
std::unique_ptr<StepKind> make_home() { return std::make_unique<Home>(); }

}  // namespace rig::steps
