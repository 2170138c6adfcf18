// SPDX-License-Identifier: MIT
#include <cmath>

#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

class Wait final : public StepKind {
 public:
  std::string name() const override { return "wait"; }
  std::string about() const override {
    return "Waits while the lidar measures, for warm-up; timed by this computer's clock, and begun again "
           "when the lidar restarts";
  }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = {
        {.name = "seconds", .about = "how long", .min = 0, .max = 1e6},
        {.name = "minutes", .about = "how long", .min = 0, .max = 20000}};
    return options;
  }
  void plan(const Arguments& arguments, Plan& plan) const override {
    if (arguments.has("seconds") == arguments.has("minutes"))
      throw ProcedureError(arguments.position(), "'wait' needs one of seconds and minutes.");
    const double planned_s = seconds(arguments);
    plan.depends_on(arguments, {"seconds", "minutes"});
    plan.seconds += std::isnan(planned_s) ? 0 : planned_s;
    plan.says =
        std::isnan(planned_s) ? "wait as long as an earlier step says" : "wait " + to_text(planned_s) + " s";
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    co_await context.wait(seconds(arguments));
  }

 private:
  static double seconds(const Arguments& arguments) {
    return arguments.number_or("seconds", 0) + 60 * arguments.number_or("minutes", 0);
  }
};

}  // namespace

std::unique_ptr<StepKind> make_wait();
std::unique_ptr<StepKind> make_wait() { return std::make_unique<Wait>(); }

}  // namespace rig::steps
