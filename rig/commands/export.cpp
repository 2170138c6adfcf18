// SPDX-License-Identifier: MIT
#include <cstdio>
#include <filesystem>

#include "rig/command.hpp"
#include "rig/errors.hpp"
#include "rig/export/exporter.hpp"

namespace rig::commands {
namespace {

class Export : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command = root.add_subcommand("export", "Writes a session or a result in another tool's format");
    std::string formats;
    for (const auto& exporter : all_exporters())
      formats += "\n  " + exporter->format() + ": " + exporter->describes();
    command->add_option("session", source_, "Session file (*.rig), or a correction (*.json)")->required();
    command->add_option("--format", format_, "See below")->required();
    command->add_option("-o,--output", output_, "File to write")->required();
    command->add_flag("--any-lidar", any_lidar_,
                      "Also a correction that was made for another lidar than the session's");
    command->footer("Formats:" + formats);
    return command;
  }

  int run() override {
    const OutputPlace output = check_output({output_}, {source_});
    std::unique_ptr<SessionStore> session;
    if (is_session_file(source_)) session = std::make_unique<SessionStore>(source_, SessionStore::Mode::read);
    for (const std::string& note : run_export(format_, {source_, session.get(), any_lidar_}, output))
      std::fprintf(stderr, "rig: %s\n", note.c_str());
    std::fprintf(stderr, "exported: %s\n", std::filesystem::absolute(output_).c_str());
    return 0;
  }

 private:
  std::string source_, format_, output_;
  bool any_lidar_ = false;
};

}  // namespace

std::unique_ptr<Command> make_export() { return std::make_unique<Export>(); }

}  // namespace rig::commands
