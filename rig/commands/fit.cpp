// SPDX-License-Identifier: MIT
#include <cstdio>
#include <map>

#include "rig/commands/different_sessions.hpp"
#include "rig/commands/json_output.hpp"
#include "rig/errors.hpp"
#include "rig/fitting/fitting.hpp"

namespace rig::commands {
namespace {

/// "k=3" to {"k": 3}: numbers, true and false as such, everything else as text.
nlohmann::json options_from(const std::vector<std::string>& pairs) {
  nlohmann::json options = nlohmann::json::object();
  for (const std::string& pair : pairs) {
    const std::size_t equals = pair.find('=');
    if (equals == std::string::npos || equals == 0)
      throw UsageError("--option takes NAME=VALUE, not '" + pair + "'");
    const std::string text = pair.substr(equals + 1);
    nlohmann::json value = nlohmann::json::parse(text, nullptr, false);
    options[pair.substr(0, equals)] = value.is_discarded() ? nlohmann::json(text) : value;
  }
  return options;
}

class Fit : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* command = root.add_subcommand("fit", "A calibration from recordings");
    command->add_option("kind", kind_, "Calibration to compute")->required();
    command->add_option("session", sessions_, "Session files")->required();
    command->add_option("--option", options_, "NAME=VALUE; 'rig fit KIND --help' lists them");
    json_.declare(*command, "the result", "result");
    command->add_flag("--no-store", no_store_, "Leave the session file as it is");
    command->footer([this] { return help(); });
    return command;
  }

  int run() override {
    check_outputs({json_.output()}, inputs());
    demand_different_sessions(sessions_);
    std::vector<std::unique_ptr<SessionStore>> stores;
    std::vector<FitSource> sources;
    for (const std::string& path : sessions_) {
      sources.push_back({path, nullptr});
      if (!is_session_file(path)) continue;
      stores.push_back(std::make_unique<SessionStore>(path, SessionStore::Mode::read));
      sources.back().session = stores.back().get();
    }
    const nlohmann::json result = run_fit(kind_, sources, options_from(options_));
    stores.clear();
    if (!no_store_) store(sources.front(), result);
    std::fputs(to_text(result).c_str(), stderr);
    json_.write(result);
    return 0;
  }

 private:
  /// Options may name files too: correction=FILE.
  [[nodiscard]] std::vector<std::string> inputs() const {
    std::vector<std::string> files = sessions_;
    for (const std::string& option : options_) files.push_back(option.substr(option.find('=') + 1));
    return files;
  }

  /// Of the calibration that was named, else of all.
  [[nodiscard]] std::string help() const {
    std::string out = "Calibrations (rig fit KIND --help lists the options of one):";
    for (const auto& fitting : all_fittings()) {
      if (fitting->kind() == kind_) return help_of(*fitting);
      out += "\n  " + fitting->kind() + ": " + fitting->describes();
    }
    return out;
  }
  static std::string help_of(const Fitting& fitting) {
    std::string out = fitting.kind() + ": " + fitting.describes();
    for (const FitOption& option : fitting.options()) out += "\n  --option " + help_text(option);
    return out;
  }

  /// A recording on read-only media can be fitted all the same; the result is then only printed.
  static void store(const FitSource& source, const nlohmann::json& result) {
    if (!source.session) return;
    try {
      SessionStore session(source.path, SessionStore::Mode::append);
      session.add_result(result.value("kind", "fit"), result.dump());
    } catch (const std::exception& error) {
      std::fprintf(stderr, "note: the result is not kept in %s (%s)\n", source.path.c_str(), error.what());
    }
  }

  std::string kind_;
  JsonOutput json_;
  std::vector<std::string> sessions_, options_;
  bool no_store_ = false;
};

}  // namespace

std::unique_ptr<Command> make_fit() { return std::make_unique<Fit>(); }

}  // namespace rig::commands
