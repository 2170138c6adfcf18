// SPDX-License-Identifier: MIT
#include "rig/report/report.hpp"

#include <cstdio>
#include <filesystem>

#include "rig/archive/history.hpp"
#include "rig/commands/archive_options.hpp"
#include "rig/commands/json_output.hpp"
#include "rig/report/certificate.hpp"
#include "rig/report/issue.hpp"
#include "rig/session/session_store.hpp"

namespace rig::commands {
namespace {

class Report : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command =
        root.add_subcommand("report", "Writes a session's calibration certificate: HTML, PDF, JSON or DCC");
    command->add_option("session", session_, "Session file (*.rig)")->required();
    command->add_option(
        "-o,--output", output_,
        "FILE.html, FILE.pdf (PDF/A-3b), FILE.json or FILE.dcc.xml (PTB's Digital Calibration "
        "Certificate, 3.2.1); default: beside the session, .html");
    command->add_flag("--no-store", no_store_,
                      "Leave the session file as it is: later issues will not know of this one");
    archive_.declare(*command);
    json_.declare(*command, "the certificate", "certificate");
    return command;
  }

  int run() override {
    const std::filesystem::path page = std::filesystem::path(session_).replace_extension(".html");
    if (output_.empty() && !json_.wanted()) output_ = page.string();
    const OutputPlace output =
        check_outputs({{output_, page.filename().string()}, json_.output()}, {session_}).front();
    const nlohmann::json previous = archive_.given() ? previous_in_archive() : nullptr;
    if (json_.wanted()) {
      const SessionStore session(session_, SessionStore::Mode::read);
      const nlohmann::json certificate = make_certificate(session, session_, previous);
      refuse_other_certificate(json_.output().path, certificate);
      json_.write(certificate);
      if (!no_store_) remember(register_with(session, certificate, json_.output().path));
    }
    if (output_.empty()) return 0;
    const IssuedReport issued = issue_report(session_, output.path(), previous);
    if (std::filesystem::path(issued.file).filename() != std::filesystem::path(output.path()).filename())
      std::fprintf(stderr, "rig: %s was there already and is kept: the report is %s\n", output.path().c_str(),
                   issued.file.c_str());
    if (!no_store_) remember(issued.certificates);
    std::fprintf(stderr, "report: %s\n", std::filesystem::absolute(issued.file).c_str());
    return 0;
  }

 private:
  /// The calibration before this one, by an archive's index.
  [[nodiscard]] nlohmann::json previous_in_archive() const {
    const std::filesystem::path path = std::filesystem::absolute(session_);
    const SessionRecord own = read_session_record(path.parent_path().string(), path.filename().string());
    nlohmann::json previous = previous_calibration(archive_.sessions(), own);
    if (previous.is_null())
      std::fprintf(
          stderr, "rig: the archive has no earlier calibration of the lidar '%s' with a quantity in common\n",
          own.serial.c_str());
    return previous;
  }

  /// A session that cannot be written now still has its report.
  void remember(const std::string& certificates) const {
    try {
      if (SessionStore(session_, SessionStore::Mode::read).get("certificates") == certificates) return;
      SessionStore session(session_, SessionStore::Mode::append);
      session.set("certificates", certificates);
    } catch (const std::exception& error) {
      std::fprintf(
          stderr,
          "rig: this issue could not be noted in the session, so later issues will not count it: %s\n",
          error.what());
    }
  }

  std::string session_, output_;
  ArchiveOption archive_;
  bool no_store_ = false;
  JsonOutput json_;
};

}  // namespace

std::unique_ptr<Command> make_report() { return std::make_unique<Report>(); }

}  // namespace rig::commands
