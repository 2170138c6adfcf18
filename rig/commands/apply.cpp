// SPDX-License-Identifier: MIT
#include <cstdio>

#include "rig/commands/json_output.hpp"
#include "rig/fitting/apply_session.hpp"
#include "rig/fitting/correction_source.hpp"

namespace rig::commands {
namespace {

double percent(long part, long whole) {
  return whole ? 100.0 * static_cast<double>(part) / static_cast<double>(whole) : 0;
}

class Apply : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command = root.add_subcommand("apply", "Corrects the ranges of a session");
    command
        ->add_option("correction", request_.correction_name,
                     "Correction (*.json), or a session that holds one")
        ->required();
    command->add_option("session", request_.input, "Session to correct")->required();
    command->add_option("-o,--output", output_, "Session file to write (*.rig)")->required();
    command
        ->add_option("--outside", outside_,
                     "Treatment of samples outside the calibrated region: hold corrects them as at its "
                     "border, drop leaves them out")
        ->check(CLI::IsMember({"hold", "drop"}))
        ->capture_default_str();
    command->add_flag("--any-lidar", request_.any_lidar,
                      "Also for a lidar other than the calibrated one, even of another model");
    json_.declare(*command, "what was done", "apply");
    return command;
  }

  int run() override {
    request_.output = check_outputs({{output_, "corrected.rig"}, json_.output()},
                                    {request_.correction_name, request_.input})
                          .front();
    request_.correction = load_correction(request_.correction_name);
    request_.drop_outside = outside_ == "drop";
    const ApplyReport report = apply_to_session(request_);
    for (const std::string& warning : report.warnings) std::fprintf(stderr, "rig: %s\n", warning.c_str());
    std::fprintf(stderr, "apply: %ld samples of %ld scans corrected, by %.2f mm on average -> %s\n",
                 report.samples, report.scans, report.mean_error_mm, output_.c_str());
    if (report.outside_range + report.outside_intensity > 0)
      std::fprintf(
          stderr,
          "apply: %.1f %% of the samples lie outside the calibrated distances, %.1f %% outside the "
          "calibrated intensities; "
          "they were %s\n",
          percent(report.outside_range, report.samples), percent(report.outside_intensity, report.samples),
          request_.drop_outside ? "left out" : "corrected as at the border of the calibrated region");
    json_.write({{"schema", "apply/1"},
                 {"scans", report.scans},
                 {"samples", report.samples},
                 {"without_echo", report.without_echo},
                 {"outside_range", report.outside_range},
                 {"outside_intensity", report.outside_intensity},
                 {"mean_error_mm", report.mean_error_mm}});
    return 0;
  }

 private:
  ApplyRequest request_;
  JsonOutput json_;
  std::string output_, outside_ = "hold";
};

}  // namespace

std::unique_ptr<Command> make_apply() { return std::make_unique<Apply>(); }

}  // namespace rig::commands
