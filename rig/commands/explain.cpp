// SPDX-License-Identifier: MIT
#include <cstdio>
#include <filesystem>

#include "fit/explain/explanation.hpp"
#include "rig/commands/different_sessions.hpp"
#include "rig/commands/json_output.hpp"
#include "rig/commands/progress_line.hpp"
#include "rig/procedure/procedure_plan.hpp"
#include "rig/report/explain_procedure.hpp"
#include "rig/report/explain_report.hpp"
#include "rig/report/pdf.hpp"
#include "rig/runner/bench_file.hpp"
#include "rig/session/session_store.hpp"

namespace rig::commands {
namespace {

class Explain : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command =
        root.add_subcommand("explain", "Finds what physics the simulation left out of a recording");
    command
        ->add_option("session", sessions_,
                     "Session files (*.rig) of one bench; several are explained together")
        ->required();
    command->add_option("--bench", bench_, "Bench file; default: the one in the session");
    json_.declare(*command, "the explanation", "explanation");
    command->add_option("--report", report_,
                        "Write the explanation as one page with pictures: FILE.html or FILE.pdf");
    command->add_option(
        "--next", next_,
        "Where to write the procedure that separates undecided suspects; default: beside the session");
    command->add_option("--predict", predicted_,
                        "Session that takes no part in the fit: what was found must predict it (repeatable)");
    command->add_flag("--no-store", no_store_, "Leave the session file as it is");
    return command;
  }

  int run() override {
    check_outputs(
        {json_.output(), {report_, "explanation.html", false, "explanation", true}, {next_, "next.yaml"}},
        inputs());
    demand_different_sessions(fitted_and_predicted());
    std::optional<fit::Bench> bench;
    if (!bench_.empty()) bench = read_bench_file(bench_);
    const nlohmann::json document = explained(bench);
    if (!no_store_ && sessions_.size() == 1) store(document);
    json_.write(document);
    if (!report_.empty()) {
      std::string names;
      for (const std::string& path : sessions_) names += (names.empty() ? "" : ", ") + path;
      write_page(report_, explanation_html(document, names));
      std::fprintf(stderr, "report: %s\n", std::filesystem::absolute(report_).c_str());
    }
    return 0;
  }

 private:
  [[nodiscard]] std::vector<std::string> fitted_and_predicted() const {
    std::vector<std::string> files = sessions_;
    files.insert(files.end(), predicted_.begin(), predicted_.end());
    return files;
  }
  [[nodiscard]] std::vector<std::string> inputs() const {
    std::vector<std::string> files = fitted_and_predicted();
    files.push_back(bench_);
    return files;
  }

  nlohmann::json explained(const std::optional<fit::Bench>& bench) {
    std::vector<std::unique_ptr<SessionStore>> stores;
    std::vector<std::unique_ptr<fit::Recording>> recordings;
    std::vector<const fit::Recording*> list;
    for (const std::string& path : sessions_) {
      stores.push_back(std::make_unique<SessionStore>(path, SessionStore::Mode::read));
      recordings.push_back(stores.back()->recording(bench));
      list.push_back(recordings.back().get());
    }
    try {
      auto explanation = [&] {
        ProgressLine line;
        const auto shown = [&](double share, const std::string& what) { line(share, what); };
        return fit::explain::explain(list, shown);
      }();
      for (const std::string& path : predicted_) {
        const SessionStore store(path, SessionStore::Mode::read);
        const auto recording = store.recording(bench);
        explanation.predictions.push_back(fit::explain::predict_recording(explanation.predictor, *recording));
        explanation.predictions.back().session = std::filesystem::path(path).filename().string();
      }
      std::fputs(fit::explain::to_text(explanation).c_str(), stderr);
      nlohmann::json document = fit::explain::to_json(explanation);
      const std::string next = next_experiment(explanation, list);
      if (!next.empty()) document["next_experiment"] = next;
      return document;
    } catch (const std::invalid_argument& error) {
      throw MeasurementError(std::string("nothing was explained: ") + error.what());
    }
  }

  static void say_what_it_needs(const fit::explain::Explanation& explanation) {
    const std::string work = what_separates(explanation);
    std::fprintf(stderr, "No experiment that this bench can do separates them.%s\n",
                 work.empty() ? "" : (" It would need " + work + ".").c_str());
  }

  /// Writes the procedure that separates the suspects best; empty when there is none or nowhere to write it.
  std::string next_experiment(const fit::explain::Explanation& explanation,
                              const std::vector<const fit::Recording*>& recordings) const {
    if (!explanation.has_rivals()) {
      if (!explanation.undecided_between.empty()) say_what_it_needs(explanation);
      return {};
    }
    const fit::Bench& bench = recordings.front()->bench();
    const StageLimits limits = stage_limits(bench);
    std::fputs("Planning the experiment that would tell them apart ...\n", stderr);
    const auto best = fit::explain::best_experiment(
        recordings, explanation, {limits.min_deg * fit::rad_per_deg, limits.max_deg * fit::rad_per_deg});
    if (!best) {
      say_what_it_needs(explanation);
      return {};
    }
    const std::string text = procedure_text(*best, bench);
    const std::string path =
        next_.empty() ? std::filesystem::path(sessions_.front()).replace_extension(".next.yaml").string()
                      : next_;
    try {
      (void)unroll(parse_procedure(text, path), bench);
      write_file_atomically(path, text);
    } catch (const std::exception& error) {
      std::fprintf(stderr, "note: the next experiment is not written (%s)\n", error.what());
      return {};
    }
    std::fprintf(stderr, "next experiment: %s: %s. %s\n", path.c_str(), best->title.c_str(),
                 promise_of(*best).c_str());
    return path;
  }

  /// A recording on read-only media can be explained all the same.
  void store(const nlohmann::json& document) {
    try {
      SessionStore session(sessions_.front(), SessionStore::Mode::append);
      session.add_result("explanation", document.dump());
    } catch (const std::exception& error) {
      std::fprintf(stderr, "note: the explanation is not kept in %s (%s)\n", sessions_.front().c_str(),
                   error.what());
    }
  }

  std::vector<std::string> sessions_, predicted_;
  std::string bench_, report_, next_;
  JsonOutput json_;
  bool no_store_ = false;
};

}  // namespace

std::unique_ptr<Command> make_explain() { return std::make_unique<Explain>(); }

}  // namespace rig::commands
