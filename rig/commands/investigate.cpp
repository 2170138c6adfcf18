// SPDX-License-Identifier: MIT
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <filesystem>

#include "rig/commands/device_run.hpp"
#include "rig/commands/json_output.hpp"
#include "rig/commands/progress_line.hpp"
#include "rig/descriptor.hpp"
#include "rig/investigate/dossier_document.hpp"
#include "rig/investigate/investigation.hpp"

namespace rig::commands {
namespace {

/// No two programs investigate in one folder.
class FolderLock {
 public:
  explicit FolderLock(const std::string& folder) : file_(open_in(folder)) {
    if (!file_) throw UsageError("cannot write into " + folder + ". Name another folder with --out.");
    if (::flock(file_.get(), LOCK_EX | LOCK_NB) != 0)
      throw UsageError("another program is investigating in " + folder +
                       ". Wait until it ends, or name another folder.");
  }

 private:
  static int open_in(const std::string& folder) {
    std::error_code ignored;
    std::filesystem::create_directories(folder, ignored);
    return ::open((std::filesystem::path(folder) / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  }

  Descriptor file_;
};

/// What Ctrl-C prints while the rig computes and no device runs: written beforehand, as a signal's handler
/// may neither allocate nor throw.
std::string words_when_stopped;

extern "C" void stop_computing(int) {
  // The status of an interrupted recording. Whatever is kept is kept already, each file whole.
  (void)!::write(STDERR_FILENO, words_when_stopped.data(), words_when_stopped.size());
  ::_exit(1);
}

void say_when_stopped() {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) std::signal(signal, stop_computing);
}

class Investigate : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command = root.add_subcommand("investigate",
                                        "Measures, explains and chooses the next experiment until the "
                                        "missing physics is named and predicts a new recording");
    command->add_option("procedure", options_.procedure,
                        "The first session's procedure; default: a short recording from several angles");
    command->add_option("--bench", bench_, "Bench file");
    command->add_option("--out", options_.folder, "Folder for sessions, state and dossier")->required();
    command
        ->add_option("--budget-min", options_.budget_min,
                     "Minutes that stage, scans and operator may take together")
        ->check(CLI::Range(0.01, 1e5, "MINUTES"))
        ->capture_default_str();
    command->add_flag("--unattended", options_.unattended,
                      "Unattended: no experiment that needs an operator");
    command->add_flag("--resume", options_.resume, "Continue the investigation in the folder");
    command
        ->add_option(
            "--on-for-min", options_.on_for_min,
            "How long the lidar has been on when the first session begins; drifts are compared by that")
        ->check(CLI::NonNegativeNumber);
    json_.declare(*command, "the dossier", "dossier");
    devices_.declare(*command);
    command->footer(
        "Ctrl-C stops the stage and keeps all data; --resume continues. The dossier says what a predicted "
        "recording has confirmed, and no more.");
    return command;
  }

  int run() override {
    if (devices_.yes)
      throw UsageError(
          "--yes would confirm prompts that nobody carries out. Give --unattended instead: experiments then "
          "need no operator.");
    if (json_.to_standard_output() && devices_.logs_json())
      throw UsageError(
          "--json - and --json-log would both write to standard output. Give --json the name of a file.");
    (void)check_outputs({json_.output()}, {options_.procedure, bench_});
    const std::string kept = (std::filesystem::path(options_.folder) / "bench.json").string();
    std::error_code ignored;
    if (bench_.empty() && options_.resume && std::filesystem::exists(kept, ignored)) bench_ = kept;
    if (bench_.empty())
      throw UsageError(
          "--bench is missing: the bench file says what stands where. `rig new bench FILE` writes a "
          "commented one.");
    const fit::Bench bench = read_bench_file(bench_);
    // One that was killed before it began has left its folder at least.
    if (options_.resume && !std::filesystem::exists(options_.folder))
      throw UsageError("there is no investigation in " + options_.folder +
                       " to continue. Check the folder's name; without --resume one is begun.");
    const FolderLock lock(options_.folder);
    const std::unique_ptr<LivePage> page = devices_.page_for_several();
    investigate::Actions actions;
    actions.record = [&](const Procedure& procedure, const std::string& session, bool resumed) {
      try {
        devices_.run(procedure, bench, session, resumed);
        say_when_stopped();  // A run has a handler of its own and leaves none.
      } catch (const RunStopped& why) {
        throw RunStopped(going_on_here(why.what(), session));
      } catch (const DeviceError& why) {
        throw DeviceError(going_on_here(why.what(), session));
      } catch (...) {
        say_when_stopped();
        throw;
      }
    };
    actions.explain = [](const std::vector<const fit::Recording*>& recordings) {
      ProgressLine line;
      return fit::explain::explain(recordings,
                                   [&line](double share, const std::string& what) { line(share, what); });
    };
    actions.say = [this](const std::string& line) {
      std::fprintf(stderr, "investigate: %s\n", line.c_str());
      if (!devices_.logs_json()) return;
      std::printf("%s\n", json{{"type", "investigation"}, {"text", line}}
                              .dump(-1, ' ', false, json::error_handler_t::replace)
                              .c_str());
      std::fflush(stdout);
    };
    if (page)
      actions.show = [&page](const json& dossier) {
        page->show_beside("investigation", investigate::for_live_page(dossier));
      };
    investigate::Investigation investigation(bench, options_, actions);
    devices_.doubts_bench = true;
    // Whatever is asked all the same has nobody to wait for.
    devices_.yes = investigation.unattended() && devices_.operator_port.empty();
    words_when_stopped =
        (isatty(STDERR_FILENO) != 0 ? "\n" : "") +
        std::string("rig: Stopped by the operator. What was recorded is kept; continue with ") +
        resume_command() + ".\n";
    say_when_stopped();
    const json dossier = investigation.run();
    json_.write(dossier);
    std::fprintf(stderr, "%s\ndossier: %s\n", dossier.at("claim").get<std::string>().c_str(),
                 (std::filesystem::absolute(options_.folder) / "dossier.html").c_str());
    return 0;
  }

 private:
  [[nodiscard]] std::string resume_command() const {
    return "rig investigate " + options_.procedure + (options_.procedure.empty() ? "" : " ") + "--out " +
           options_.folder + " --resume --lidar " + devices_.lidar + " --stage " + devices_.stage;
  }

  /// What a run says of how to go on, for one that is part of an investigation.
  [[nodiscard]] std::string going_on_here(std::string words, const std::string& session) const {
    const std::string command = resume_command();
    for (const std::string& of_one : {"rig resume " + session, std::string("rig resume")})
      for (auto at = words.find(of_one); at != std::string::npos;
           at = words.find(of_one, at + command.size()))
        words.replace(at, of_one.size(), command);
    return words;
  }

  std::string bench_;
  investigate::Options options_;
  JsonOutput json_;
  DeviceRun devices_;
};

}  // namespace

std::unique_ptr<Command> make_investigate() { return std::make_unique<Investigate>(); }

}  // namespace rig::commands
