// SPDX-License-Identifier: MIT
#include <algorithm>
#include <filesystem>

#include "rig/procedure/procedure.hpp"
#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

/// What is wrong with a report's name; empty if nothing is.
std::string fault_of(const std::filesystem::path& file) {
  if (file.is_absolute() || std::ranges::find(file, "..") != file.end())
    return "would leave the session's folder; give a relative name without '..'.";
  const std::string ending = file.extension().string();
  if (ending != ".html" && ending != ".pdf" && ending != ".json" && !file.string().ends_with(".dcc.xml"))
    return "must end in .html, .pdf, .json or .dcc.xml.";
  return "";
}

class Report final : public StepKind {
 public:
  std::string name() const override { return "report"; }
  std::string about() const override { return "Writes the certificate beside the session file"; }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = {
        {.name = "file",
         .type = Option::Type::path,
         .about = "name ending in .html, .pdf, .json or .dcc.xml, inside the output folder",
         .required = true}};
    return options;
  }
  bool only_reports() const override { return true; }
  void plan(const Arguments& arguments, Plan& plan) const override {
    const std::string file = arguments.text_or("file", "report.html");
    // Found now, and not after the hours of captures before it.
    if (const std::string fault = fault_of(file); !fault.empty())
      throw ProcedureError(arguments.position_of("file"), "the report '" + file + "' " + fault);
    plan.seconds += 1;
    plan.says = "report to " + arguments.text_or("file", "");
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    co_await context.report(arguments.text_or("file", "report.html"));
  }
};

}  // namespace

std::unique_ptr<StepKind> make_report();
std::unique_ptr<StepKind> make_report() { return std::make_unique<Report>(); }

}  // namespace rig::steps
