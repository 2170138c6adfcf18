// SPDX-License-Identifier: MIT
#include "rig/report/report.hpp"

#include <cstdio>
#include <filesystem>

#include "rig/commands/json_output.hpp"
#include "rig/report/certificate.hpp"
#include "rig/session/session_store.hpp"

namespace rig::commands {
namespace {

class Report : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command =
        root.add_subcommand("report", "Writes a session's calibration certificate: HTML, PDF, JSON or DCC");
    command->add_option("session", session_, "Session file (*.rig)")->required();
    command->add_option("-o,--output", output_,
                        "FILE.html, FILE.pdf (PDF/A-3b), FILE.json or FILE.dcc.xml (PTB's Digital Calibration "
                        "Certificate, 3.2.1); default: beside the session, .html");
    json_.declare(*command, "the certificate");
    return command;
  }

  int run() override {
    const std::filesystem::path page = std::filesystem::path(session_).replace_extension(".html");
    if (output_.empty() && !json_.wanted()) output_ = page.string();
    const OutputPlace output =
        check_outputs({{output_, page.filename().string()}, json_.output()}, {session_}).front();
    if (json_.wanted())
      json_.write(make_certificate(SessionStore(session_, SessionStore::Mode::read), session_));
    if (output_.empty()) return 0;
    const IssuedReport issued = issue_report(session_, output.path());
    if (std::filesystem::path(issued.file).filename() != std::filesystem::path(output.path()).filename())
      std::fprintf(stderr, "rig: %s is another certificate and was kept\n", output.path().c_str());
    remember(issued.certificates);
    std::fprintf(stderr, "report: %s\n", std::filesystem::absolute(issued.file).c_str());
    return 0;
  }

 private:
  /// A session that cannot be written now still has its report.
  void remember(const std::string& certificates) const {
    try {
      if (SessionStore(session_, SessionStore::Mode::read).get("certificates") == certificates) return;
      SessionStore session(session_, SessionStore::Mode::append);
      session.set("certificates", certificates);
    } catch (const std::exception& error) {
      std::fprintf(stderr, "rig: the session does not remember this issue, which later ones will not count: %s\n",
                   error.what());
    }
  }

  std::string session_, output_;
  JsonOutput json_;
};

}  // namespace

std::unique_ptr<Command> make_report() { return std::make_unique<Report>(); }

}  // namespace rig::commands
