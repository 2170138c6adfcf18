// SPDX-License-Identifier: MIT
#include "rig/report/report.hpp"

#include <cstdio>
#include <filesystem>

#include "rig/command.hpp"
#include "rig/whole_file.hpp"

namespace rig::commands {
namespace {

class Report : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command =
        root.add_subcommand("report", "Writes a session's calibration certificate: HTML, PDF or JSON");
    command->add_option("session", session_, "Session file (*.rig)")->required();
    command->add_option("-o,--output", output_,
                        "FILE.html, FILE.pdf or FILE.json; default: beside the session, .html");
    command->add_option("--json", json_, "Write the certificate as JSON to FILE, or '-' for standard output");
    return command;
  }

  int run() override {
    if (!json_.empty()) {
      const SessionStore session(session_, SessionStore::Mode::read);
      const std::string text = certificate_text(session, session_);
      if (json_ == "-")
        std::fwrite(text.data(), 1, text.size(), stdout);
      else
        write_file_atomically(json_, text);
      if (output_.empty()) return 0;
    }
    if (output_.empty()) output_ = std::filesystem::path(session_).replace_extension(".html").string();
    write_report(session_, output_);
    std::fprintf(stderr, "report: %s\n", std::filesystem::absolute(output_).c_str());
    return 0;
  }

 private:
  std::string session_, output_, json_;
};

}  // namespace

std::unique_ptr<Command> make_report() { return std::make_unique<Report>(); }

}  // namespace rig::commands
