// SPDX-License-Identifier: MIT
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/commands/device_run.hpp"

namespace rig::commands {
namespace {

/// The part of "serial:PATH?options" that is a file; empty if it is none.
std::string port_file(const std::string& address) {
  constexpr std::string_view scheme = "serial:";
  if (!address.starts_with(scheme)) return "";
  const std::string path = address.substr(scheme.size());
  return path.substr(0, path.find('?'));
}

class Resume : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* resume =
        root.add_subcommand("resume", "Continues an interrupted run; all that it needs is in its session");
    resume->add_option("session", session_, "Session file (*.rig)")->required();
    devices_.declare(*resume);
    resume->add_flag("--attended", attended_,
                     "A person answers prompts, though the run was begun with --yes");
    resume->footer(
        "Procedure, bench, variables and addresses are the session's. An address given here replaces one "
        "that "
        "has changed; one that is no longer there is asked for.");
    return resume;
  }

  int run() override {
    const SessionStore stored(session_, SessionStore::Mode::read);
    if (stored.get("ended") == "done") {
      std::fprintf(stderr, "rig: all steps of %s are done: nothing is left to resume.\n", session_.c_str());
      const json limits = json::parse(stored.latest_result("limits").value_or("{}"), nullptr, false);
      if (limits.is_object() && !all_pass(limits.value("checks", json::array())))
        throw MeasurementError("not every limit is met; the report says which and why.");
      return 0;
    }
    const std::string text = needed(stored, "procedure");
    const std::string name = session_ + " (its procedure)";
    Variables variables;
    const json known = json::parse(stored.get("variables").value_or("{}"), nullptr, false);
    for (const auto& [key, value] : known.items()) variables[key] = value_in(value);
    const Procedure procedure = parse_procedure(text, name, variables);
    const fit::Bench bench = read_bench_text(needed(stored, "bench"), session_ + " (its bench)");
    (void)unroll(procedure, bench);
    complete_addresses(json::parse(stored.get("devices").value_or("{}"), nullptr, false));
    return devices_.run(procedure, bench, session_, true);
  }

 private:
  std::string needed(const SessionStore& stored, const char* key) const {
    if (const auto text = stored.get(key)) return *text;
    throw UsageError(session_ + " holds no " + key +
                     ": it was imported, or ended before its run began. Begin a run with `rig run`.");
  }

  static Value value_in(const json& stored) {
    if (stored.is_number()) return stored.get<double>();
    if (stored.is_boolean()) return stored.get<bool>();
    return stored.is_string() ? stored.get<std::string>() : stored.dump();
  }

  /// Those of the command line, else the session's, else what a person types.
  void complete_addresses(const json& before) {
    const auto stored = [&](const char* key) {
      return before.is_object() && before.contains(key) && before[key].is_string()
                 ? before[key].get<std::string>()
                 : std::string();
    };
    const bool nobody = before.is_object() && before.value("yes", false);
    if (devices_.operator_port.empty() && !devices_.yes && !attended_) {
      devices_.operator_port = stored("operator");
      devices_.yes = nobody;
    }
    if (devices_.lidar.empty()) devices_.lidar = stored("lidar");
    if (devices_.lidar.empty())
      devices_.lidar =
          asked("lidar", "--lidar tcp://HOST[:PORT]", "The session does not say where the lidar is.");
    if (devices_.stage.empty()) {
      devices_.stage = stored("stage");
      const std::string file = port_file(devices_.stage);
      std::error_code ignored;
      if (devices_.stage.empty())
        devices_.stage =
            asked("stage", "--stage serial:PATH", "The session does not say where the stage is.");
      else if (!file.empty() && !std::filesystem::exists(file, ignored))
        devices_.stage = asked("stage", "--stage serial:PATH",
                               "The stage was at " + devices_.stage + ", which is no longer there.");
    }
  }

  std::string asked(const std::string& what, const std::string& option, const std::string& why) const {
    char typed[1024] = "";
    if (!devices_.yes) {
      std::fprintf(stderr, "%s Address of the %s (%s): ", why.c_str(), what.c_str(),
                   option.substr(option.find(' ') + 1).c_str());
      // Prompts read the same input later: nothing of theirs may be taken with this line.
      std::setvbuf(stdin, nullptr, _IONBF, 0);
      if (!std::fgets(typed, sizeof typed, stdin)) typed[0] = '\0';
    }
    std::string address = typed;
    while (!address.empty() && (address.back() == '\n' || address.back() == '\r' || address.back() == ' '))
      address.pop_back();
    if (address.empty()) throw UsageError(why + " No address was typed: give " + option + ".");
    return address;
  }

  std::string session_;
  DeviceRun devices_;
  bool attended_ = false;
};

}  // namespace

std::unique_ptr<Command> make_resume() { return std::make_unique<Resume>(); }

}  // namespace rig::commands
