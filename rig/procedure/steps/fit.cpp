// SPDX-License-Identifier: MIT
#include <nlohmann/json.hpp>

#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

using Type = Option::Type;

class Fit final : public StepKind {
 public:
  std::string name() const override { return "fit"; }
  const Node* calibration(const Node& options) const override { return options.find("kind"); }
  std::string about() const override {
    return "Computes a calibration from what was captured so far (as `rig fit KIND`)";
  }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = {
        {.name = "kind",
         .type = Type::text,
         .about = "centre, sensitivity, range, wall ...",
         .required = true},
        {.name = "options", .type = Type::map, .about = "what the fit takes, by name"}};
    return options;
  }
  void plan(const Arguments& arguments, Plan& plan) const override {
    plan.seconds += 2;
    plan.says = "fit " + arguments.text_or("kind", "");
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    co_await context.fit(arguments.text_or("kind", ""), arguments.json("options"));
  }
};

}  // namespace

std::unique_ptr<StepKind> make_fit();
std::unique_ptr<StepKind> make_fit() { return std::make_unique<Fit>(); }

}  // namespace rig::steps
