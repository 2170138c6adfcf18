// SPDX-License-Identifier: MIT
#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

using Type = Option::Type;

class Capture final : public StepKind {
 public:
  std::string name() const override { return "capture"; }
  bool measures() const override { return true; }
  std::string about() const override { return "Records scans with the stage at rest"; }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = [] {
      std::vector<Option> all = {{.name = "samples",
                                  .type = Type::integer,
                                  .about = "scans to record",
                                  .required = true,
                                  .min = 1,
                                  .max = 10'000'000}};
      for (auto& option : capture_options()) all.push_back(option);
      return all;
    }();
    return options;
  }
  void plan(const Arguments& arguments, Plan& plan) const override {
    const auto request = capture_request(arguments, *plan.bench, arguments.integer_or("samples", 1));
    plan.capture(request.samples, request.spacing_s);
    plan.depends_on(arguments, {"samples", "spacing_s"});
    plan.says = "capture " + std::to_string(request.samples) + " scans" +
                (request.spacing_s > 0 ? ", " + to_text(request.spacing_s) + " s apart" : "") +
                (request.target ? " of " + *request.target : "");
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    CaptureRequest request = capture_request(arguments, context.bench(), arguments.integer_or("samples", 1));
    request.name = context.name();
    request.key = context.key() + "/capture";
    co_await context.capture(request);
  }
};

}  // namespace

std::unique_ptr<StepKind> make_capture();
std::unique_ptr<StepKind> make_capture() { return std::make_unique<Capture>(); }

}  // namespace rig::steps
