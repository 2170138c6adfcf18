// SPDX-License-Identifier: MIT
#include "rig/step.hpp"

namespace rig::steps {
namespace {

class Report final : public StepKind {
 public:
  std::string name() const override { return "report"; }
  std::string about() const override { return "Writes the certificate beside the session file"; }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = {
        {.name = "file",
         .type = Option::Type::place,
         .about = "name ending in .html, .pdf or .json, inside the output folder",
         .required = true}};
    return options;
  }
  void plan(const Arguments& arguments, Plan& plan) const override {
    plan.seconds += 1;
    plan.says = "report to " + arguments.text_or("file", "");
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    context.report(arguments.text_or("file", "report.html"));
    co_return;
  }
};

}  // namespace

std::unique_ptr<StepKind> make_report();
std::unique_ptr<StepKind> make_report() { return std::make_unique<Report>(); }

}  // namespace rig::steps
