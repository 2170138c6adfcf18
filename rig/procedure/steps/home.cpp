// SPDX-License-Identifier: MIT
#include <cmath>

#include "rig/procedure/procedure_plan.hpp"
#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

using Type = Option::Type;

constexpr double at_zero_deg = 0.01;  // A step of the finest stage that the sources use.

class Home final : public StepKind {
 public:
  std::string name() const override { return "home"; }
  bool homes_stage() const override { return true; }
  std::string about() const override {
    return "Finds the stage's reference, unless the stage knows it already, and leaves the stage at 0 deg";
  }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = {
        {.name = "again", .type = Type::flag, .about = "home even if the stage says that it is homed"}};
    return options;
  }
  void plan(const Arguments&, Plan& plan) const override {
    plan.seconds += 180 / plan.limits.speed_deg_s;
    plan.homed = true;
    plan.stage_deg = plan.likely_deg = 0;
    plan.says = "home the stage";
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    co_await context.home(arguments.flag_or("again", false));
    // Where the last run left a stage that is still homed, what follows would look elsewhere than after a
    // homing.
    const StageLimits limits = stage_limits(context.bench());
    const bool may_stand_at_zero = limits.min_deg <= 0 && limits.max_deg >= 0;
    if (may_stand_at_zero && std::abs(context.stage_deg()) > at_zero_deg)
      co_await context.move_to(0, 0, arguments.position());
  }
};

}  // namespace

std::unique_ptr<StepKind> make_home();
std::unique_ptr<StepKind> make_home() { return std::make_unique<Home>(); }

}  // namespace rig::steps
