// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

using Type = Option::Type;

class Turn final : public StepKind {
 public:
  std::string name() const override { return "turn"; }
  bool measures() const override { return true; }
  bool turns_stage() const override { return true; }
  std::string about() const override { return "Captures while the stage turns at a constant rate"; }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = [] {
      std::vector<Option> all = {{.name = "rate_deg_s",
                                  .about = "rate of turning, counter-clockwise positive",
                                  .required = true,
                                  .min = -360,
                                  .max = 360},
                                 {.name = "from_deg", .about = "angle to start from", .required = true},
                                 {.name = "samples",
                                  .type = Type::integer,
                                  .about = "scans to capture",
                                  .required = true,
                                  .min = 1,
                                  .max = 20000}};
      for (auto& option : capture_options()) all.push_back(option);
      return all;
    }();
    return options;
  }
  void plan(const Arguments& arguments, Plan& plan) const override {
    const double rate = arguments.number("rate_deg_s"), from = arguments.number("from_deg");
    demand_turning(arguments);
    const int samples = arguments.integer_or("samples", 1);
    const CaptureRequest request = capture_request(arguments, *plan.bench, samples);
    plan.move_to(from, arguments.position_of("from_deg"), rate > 0 ? 1 : -1);
    // std::max ignores a spacing that is not known yet.
    const double lasts_s = samples * std::max(1 / plan.bench->lidar.scan_hz, request.spacing_s) + 1;
    const double end = from + rate * lasts_s;
    if (end < plan.limits.min_deg || end > plan.limits.max_deg)
      throw ProcedureError(arguments.position(),
                           "turning would end near " + to_text(std::round(end)) +
                               " deg, beyond the stage's soft limits " + to_text(plan.limits.min_deg) +
                               " to " + to_text(plan.limits.max_deg) +
                               " deg; take fewer samples, a lower rate or another start.");
    plan.capture(samples, request.spacing_s);
    plan.depends_on(arguments, {"rate_deg_s", "samples", "spacing_s"});
    plan.seconds += 1;
    plan.travel_deg += std::isnan(rate) ? 0 : std::abs(rate * lasts_s);
    plan.stage_deg = NAN;
    if (!std::isnan(end)) plan.likely_deg = end;
    const auto known = [](double value) { return std::isnan(value) ? "?" : to_text(value); };
    plan.says = "turn at " + known(rate) + " deg/s from " + known(from) + " deg, " + std::to_string(samples) +
                " scans";
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    demand_turning(arguments);  // The rate may be a value that only the run knows.
    CaptureRequest request = capture_request(arguments, context.bench(), arguments.integer_or("samples", 1));
    request.name = context.name();
    request.key = context.key() + "/capture";
    request.rate_deg_s = arguments.number("rate_deg_s");
    co_await context.capture_turning(request, arguments.number("from_deg"),
                                     arguments.position_of("from_deg"));
  }

 private:
  static void demand_turning(const Arguments& arguments) {
    if (arguments.number("rate_deg_s") == 0)
      throw ProcedureError(arguments.position_of("rate_deg_s"), "a rate of 0 is a 'capture', not a 'turn'.");
  }
};

}  // namespace

std::unique_ptr<StepKind> make_turn();
std::unique_ptr<StepKind> make_turn() { return std::make_unique<Turn>(); }

}  // namespace rig::steps
