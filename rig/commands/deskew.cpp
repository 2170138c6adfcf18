// SPDX-License-Identifier: MIT
#include <cstdio>

#include "rig/commands/json_output.hpp"
#include "rig/fitting/deskew_session.hpp"
#include "rig/fitting/fitting.hpp"

namespace rig::commands {
namespace {

class Deskew : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command = root.add_subcommand("deskew", "Removes the motion distortion of a moving lidar's scans");
    command->add_option("session", input_, "Session with odometry or a stage track")->required();
    command->add_option("-o,--output", output_, "Session file to write (*.rig)")->required();
    command->add_option("--offset-ms", options_.offset_ms,
                        "Path time minus scan time; default: estimated from the scans");
    command
        ->add_option("--beam-order", order_, "forward, reverse or auto: how beams follow each other in time")
        ->check(CLI::IsMember({"forward", "reverse", "auto"}))
        ->capture_default_str();
    command->add_flag("--odometry-only", odometry_only_, "No matching: odometry at each beam's own time");
    command
        ->add_option("--odometry-u", options_.odometry_u,
                     "Relative standard uncertainty of the odometry over one scan")
        ->check(CLI::Range(0.001, 10.0))
        ->capture_default_str();
    command->add_option("--reference", reference_,
                        "Compare the scans with a session of the same scene at rest, or with the part of the "
                        "recording in which the carrier stood near X_MM,Y_MM,HEADING_DEG");
    json_.declare(*command, "the result", "result");
    return command;
  }

  int run() override {
    const OutputPlace output =
        check_outputs({{output_, "straight.rig"}, json_.output()}, {input_, reference_}).front();
    options_.fuse = !odometry_only_;
    if (order_ != "auto") options_.reversed = order_ == "reverse";
    if (!reference_.empty()) options_.reference = std::make_shared<const DeskewReference>(reference_);
    const nlohmann::json result = deskew_session(input_, output, options_);
    std::fputs(to_text(result).c_str(), stderr);
    for (const auto& row : result["tables"][0]["rows"])
      std::fprintf(stderr, "  %-42s within 20 scans %s mm, whole map %s mm\n",
                   row[0].get<std::string>().c_str(), row[1].dump().substr(0, 5).c_str(),
                   row[2].dump().substr(0, 5).c_str());
    json_.write(result);
    return 0;
  }

 private:
  DeskewOptions options_;
  JsonOutput json_;
  std::string input_, output_, order_ = "auto", reference_;
  bool odometry_only_ = false;
};

}  // namespace

std::unique_ptr<Command> make_deskew() { return std::make_unique<Deskew>(); }

}  // namespace rig::commands
