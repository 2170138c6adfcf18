// SPDX-License-Identifier: MIT
#include <malloc.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "fit/bench/json_position.hpp"
#include "rig/command.hpp"
#include "rig/errors.hpp"
#include "rig/session/session_file.hpp"

namespace rig::commands {
std::vector<std::unique_ptr<Command>> all();
}

namespace {

constexpr const char* exit_status =
    "Exit status: 0 done, and every limit met; 1 the measurement or fit failed or was stopped, or a limit is "
    "not "
    "met; 2 wrong usage or an unreadable file; 3 a device failed or was lost; 130 ended at once by Ctrl-C.";

/// `rig explain` asks for matrices of megabytes all the time: else each is mapped, cleared and given back by
/// the kernel, which takes a quarter of the time of short sessions.
void keep_freed_memory() {
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 256 << 20);
}

/// Words of files and devices stand in messages: control characters in them must not reach the terminal.
void report(const std::exception& error) {
  std::string words = error.what();
  for (char& c : words)
    if ((static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\t') || c == 0x7F) c = '?';
  std::fprintf(stderr, "rig: %s\n", words.c_str());
}

/// What to say of a first word that is neither a subcommand nor an option; empty if it is one. The parser's
/// own words are that a subcommand is missing.
std::string unknown_first_word(int argc, char** argv, const CLI::App& app,
                               const std::vector<CLI::App*>& commands) {
  const std::string word = argc > 1 ? argv[1] : "";
  if (word.empty()) return "";
  std::vector<std::string> names;
  if (word.front() == '-') {
    const std::string name = word.substr(0, word.find('='));
    if (app.get_option_no_throw(name) != nullptr) return "";
    for (const CLI::Option* option : app.get_options()) names.push_back(option->get_name());
    return "rig has no option '" + name + "' of its own" +
           fit::ending_with_guess(fit::nearest_word(name, names)) +
           " `rig --help` lists them; those of a subcommand follow its name.";
  }
  for (const CLI::App* command : commands) names.push_back(command->get_name());
  if (std::find(names.begin(), names.end(), word) != names.end()) return "";
  return "there is no subcommand '" + word + "'" + fit::ending_with_guess(fit::nearest_word(word, names)) +
         " `rig --help` lists them.";
}

/// The parser takes whatever follows an option for its value, another option too.
void refuse_options_as_values(const std::vector<CLI::App*>& commands) {
  const auto no_option = [](const std::string& value) {
    const bool is_option = value.size() > 2 && value.starts_with("--") && value[2] != '-';
    return is_option ? "a value is missing: the option " + value + " follows" : std::string();
  };
  for (CLI::App* command : commands)
    for (CLI::Option* option : command->get_options())
      if (!option->get_positional() && option->get_expected_min() > 0) option->check(no_option, "");
}

/// What to say of a word that a subcommand has no use for; empty if it is not for that that it was refused.
std::string unexpected_word(const std::vector<CLI::App*>& commands) {
  for (const CLI::App* command : commands) {
    const std::vector<std::string> words =
        command->parsed() ? command->remaining() : std::vector<std::string>();
    if (words.empty()) continue;
    const std::string& word = words.front();
    const std::string help = " `rig " + command->get_name() + " --help` says what it takes.";
    if (!word.starts_with('-')) return "'" + word + "' is one argument too many." + help;
    std::vector<std::string> names;
    for (const CLI::Option* option : command->get_options()) names.push_back(option->get_name());
    const std::string name = word.substr(0, word.find('='));
    return "rig " + command->get_name() + " has no option '" + name + "'" +
           fit::ending_with_guess(fit::nearest_word(name, names)) + help;
  }
  return "";
}

/// What the parser says of a command line that it refuses, in the words of all other messages.
std::string words_of(const CLI::ParseError& error, const std::vector<CLI::App*>& commands) {
  const bool may_be_misspelt = dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr ||
                               dynamic_cast<const CLI::RequiredError*>(&error) != nullptr;
  if (const std::string words = unexpected_word(commands); may_be_misspelt && !words.empty()) return words;
  const std::string what = error.what();
  const auto parsed = std::ranges::find_if(commands, [](const CLI::App* each) { return each->parsed(); });
  if (parsed == commands.end()) return "a subcommand is missing. `rig --help` lists them.";
  const std::string command = "rig " + (*parsed)->get_name();
  const std::string help = ". `" + command + " --help` says what it takes.";
  for (const CLI::Option* option : (*parsed)->get_options()) {
    const std::string name = option->get_name(), about = ": " + option->get_description() + help;
    if (what == name + " is required") return command + " needs " + name + about;
    if (const std::string refused = "Could not convert: " + name + " = "; what.starts_with(refused))
      return command + " does not take '" + what.substr(refused.size()) + "' for " + name + about;
    if (!what.starts_with(name + ": ")) continue;
    const int count = option->get_expected_min();
    const bool is_count = dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr && count > 0;
    return is_count ? command + " takes " + (count == 1 ? "a value" : std::to_string(count) + " values") +
                          " for " + name + about
                    : command + ", " + what + help;
  }
  return command + ": " + what + help;
}

/// Says of the sessions that are named which have a log beside them, and in the end which are one file again.
class LogNotes {
 public:
  LogNotes(int argc, char** argv) {
    for (int i = 2; i < argc; ++i)
      if (const std::string words = rig::words_about_log(argv[i]); !words.empty()) {
        std::fprintf(stderr, "note: %s\n", words.c_str());
        named_.emplace_back(argv[i]);
      }
  }
  ~LogNotes() {
    std::error_code ignored;
    for (const std::string& session : named_)
      if (std::filesystem::exists(session, ignored) && rig::words_about_log(session).empty())
        std::fprintf(stderr, "note: %s is one file again: nothing else need be copied with it.\n",
                     session.c_str());
  }
  LogNotes(const LogNotes&) = delete;
  LogNotes& operator=(const LogNotes&) = delete;

 private:
  std::vector<std::string> named_;
};

}  // namespace

int main(int argc, char** argv) {
  keep_freed_memory();
  CLI::App app{
      "Calibration rig controller: runs procedures on a lidar and a rotary stage, fits, explains, reports.",
      "rig"};
  app.set_version_flag("--version", "rig " RIG_VERSION);
  app.require_subcommand(1);
  app.footer(exit_status);
  std::signal(SIGXFSZ, SIG_IGN);  // A file that may not grow is a full disk, told in words.
  auto commands = rig::commands::all();
  std::vector<CLI::App*> declared;
  for (const auto& command : commands) {
    declared.push_back(command->declare(app));
    if (const std::string own = declared.back()->get_footer(); own.find(exit_status) == std::string::npos)
      declared.back()->footer(own + "\n" + exit_status);
  }
  if (const std::string wrong = unknown_first_word(argc, argv, app, declared); !wrong.empty()) {
    std::fprintf(stderr, "rig: %s\n", wrong.c_str());
    return 2;
  }
  refuse_options_as_values(declared);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // Help and version.
    std::fprintf(stderr, "rig: %s\n", words_of(error, declared).c_str());
    return 2;
  }
  const LogNotes notes(argc, argv);
  try {
    for (std::size_t i = 0; i < commands.size(); ++i)
      if (declared[i]->parsed()) return commands[i]->run();
  } catch (const rig::UsageError& error) {
    report(error);
    return 2;
  } catch (const rig::DeviceError& error) {
    report(error);
    return 3;
  } catch (const std::exception& error) {
    report(error);
    return 1;
  }
  return 0;
}
