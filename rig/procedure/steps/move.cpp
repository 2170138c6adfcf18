// SPDX-License-Identifier: MIT
#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

class Move final : public StepKind {
 public:
  std::string name() const override { return "move"; }
  std::string about() const override { return "Moves the stage to an angle, or by an angle"; }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = {{.name = "to_deg", .about = "angle to move to"},
                                                {.name = "by_deg", .about = "angle to move by"},
                                                approach_option()};
    return options;
  }
  void plan(const Arguments& arguments, Plan& plan) const override {
    if (arguments.has("to_deg") == arguments.has("by_deg"))
      throw ProcedureError(arguments.position(), "'move' needs one of to_deg and by_deg.");
    const double target = target_deg(arguments, plan.stage_deg);
    plan.move_to(target, arguments.position(), approach_of(arguments, plan.rules.approach));
    plan.says = target == target ? "move to " + rounded_text(target, 4) + " deg"
                                 : "move to an angle found in an earlier step";
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    // Relative moves are turned into absolute targets: repeated rounded steps drift (2.8 deg a turn on a
    // 4266.67/deg stage, measured).
    const double target = target_deg(arguments, context.stage_deg());
    co_await context.move_to(target, approach_of(arguments, context.rules().approach), arguments.position());
  }

 private:
  static double target_deg(const Arguments& arguments, double from_deg) {
    return arguments.has("to_deg") ? arguments.number("to_deg") : from_deg + arguments.number_or("by_deg", 0);
  }
};

}  // namespace

std::unique_ptr<StepKind> make_move();
std::unique_ptr<StepKind> make_move() { return std::make_unique<Move>(); }

}  // namespace rig::steps
