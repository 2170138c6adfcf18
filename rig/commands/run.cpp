// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "fit/numeric/utf8.hpp"
#include "rig/commands/device_run.hpp"
#include "rig/runner/bench_doubts.hpp"
#include "rig/runner/bench_file.hpp"

namespace rig::commands {
namespace {

void check_fit_at(const FilePosition& position, const std::string& kind, const json& options) {
  try {
    check_fit(kind, options);
  } catch (const UsageError& error) {
    throw ProcedureError(position, error.what());
  }
}

/// A value as it stands in the file; null where only the run will know it.
json value_before_run(const Node& node, const Variables& variables) {
  if (node.kind != Node::Kind::scalar) return json::array();  // No option takes a list or a map.
  try {
    const Value value = evaluate_text(node.scalar, variables);
    if (const auto* number = std::get_if<double>(&value)) return *number;
    if (const auto* flag = std::get_if<bool>(&value)) return *flag;
    if (const auto* text = std::get_if<std::string>(&value)) return *text;
  } catch (const ExpressionError&) {  // It uses what a step defines.
  }
  return nullptr;
}

/// A calibration that does not exist, and an option that it would refuse, are found before the hours of its
/// captures.
void check_fits(const std::vector<Step>& steps, const Variables& variables) {
  for (const Step& step : steps) {
    check_fits(step.steps, variables);
    const Node* kind = step.kind->calibration(step.options);
    if (!kind || has_expression(kind->scalar)) continue;
    check_fit_at(kind->position, kind->scalar, nullptr);
    const Node* options = step.options.find("options");
    if (!options) continue;
    for (const auto& [name, value] : options->members)
      check_fit_at(value.position, kind->scalar, {{name.scalar, value_before_run(value, variables)}});
  }
}

/// Says what the calibrations' options leave open, where all of them are known.
void note_doubts_about_fits(const std::vector<Step>& steps, const Variables& variables, std::FILE* out) {
  for (const Step& step : steps) {
    note_doubts_about_fits(step.steps, variables, out);
    const Node* kind = step.kind->calibration(step.options);
    if (!kind || has_expression(kind->scalar)) continue;
    json given = json::object();
    if (const Node* options = step.options.find("options"))
      for (const auto& [name, value] : options->members)
        given[name.scalar] = value_before_run(value, variables);
    if (std::ranges::any_of(given, [](const json& value) { return value.is_null(); })) continue;
    if (const std::string doubt = doubt_about_fit(kind->scalar, given); !doubt.empty())
      std::fprintf(out, "note: %s: %s: %s\n", kind->position.text().c_str(), kind->scalar.c_str(),
                   doubt.c_str());
  }
}

/// The calibrations of the steps; false if only the run will know one of them.
bool add_kinds(const std::vector<Step>& steps, std::vector<std::string>& kinds) {
  bool all_known = true;
  for (const Step& step : steps) {
    if (!add_kinds(step.steps, kinds)) all_known = false;
    const Node* kind = step.kind->calibration(step.options);
    if (!kind) continue;
    if (has_expression(kind->scalar)) all_known = false;
    kinds.push_back(kind->scalar);
  }
  return all_known;
}

/// A limit on what no result of the run can have would leave it undecided after hours.
void check_limits_before_run(const Procedure& procedure) {
  std::vector<std::string> kinds;
  const bool all_known = add_kinds(procedure.steps, kinds);
  for (const Limit& limit : procedure.limits) {
    try {
      check_value(limit.kind, limit.value);
    } catch (const UsageError& error) {
      throw ProcedureError(limit.position, error.what());
    }
    if (all_known && std::ranges::find(kinds, limit.kind) == kinds.end())
      throw ProcedureError(limit.position,
                           "the limit '" + limit.name + "' is on a result of '" + limit.kind +
                               "', which no step of the procedure computes. Add the step `fit: "
                               "{kind: " +
                               limit.kind + "}`, or leave the limit out.");
  }
}

class Run : public Command {
 public:
  CLI::App* declare(CLI::App& root) override {
    auto* run = root.add_subcommand("run", "Runs a procedure on a lidar and a stage");
    run->add_option("procedure", procedure_, "Procedure file, or the name of a ready one")->required();
    run->add_option("--bench", bench_, "Bench file; a resumed run takes it from its session");
    run->add_option("--out", out_, "Session file to write; default: the procedure's name with .rig");
    run->add_flag("--resume", resume_, "Continue the session file where it was interrupted");
    run->add_option("--set", settings_, "NAME=VALUE: replaces a variable of the procedure");
    run->add_flag("--dry-run", dry_run_, "Print steps, travel, time and limits; touch no device");
    devices_.declare(*run);
    run->footer(
        "Ctrl-C stops the stage, switches the lidar's laser off and keeps all data; `rig resume` continues.");
    return run;
  }

  int run() override {
    const Procedure procedure = read_procedure(find_procedure(procedure_), overrides());
    check_fits(procedure.steps, procedure.variables);
    check_limits_before_run(procedure);
    if (out_.empty()) out_ = procedure.name + ".rig";
    demand_place_of_reports(procedure.steps);
    demand_place_to_write();
    const fit::Bench bench = known_bench();
    const auto plan =
        unroll(procedure, bench);      // What the bench forbids is found before anything is touched.
    (void)bench_stage_options(bench);  // What it refuses is refused before a dry run says that all is well.
    if (dry_run_) {
      std::fputs(dry_run_text(procedure, bench, plan).c_str(), stdout);
      note_doubts_about_fits(procedure.steps, procedure.variables, stdout);
      return list_doubts(bench);
    }
    note_doubts_about_fits(procedure.steps, procedure.variables, stderr);
    return devices_.run(procedure, bench, out_, continues());
  }

 private:
  Variables overrides() const {
    Variables values;
    for (const std::string& setting : settings_) {
      if (fit::first_beyond_utf8(setting) != std::string::npos)
        throw UsageError(
            "--set " + fit::as_utf8(setting) +
            ": it has a letter that is not in the encoding UTF-8. Set the terminal to UTF-8, or write "
            "the value without that letter.");
      const auto equals = setting.find('=');
      if (equals == std::string::npos || equals == 0)
        throw UsageError("--set " + setting +
                         ": it takes NAME=VALUE, one of the procedure's variables and its value, as in --set "
                         "samples=100.");
      const std::string name = setting.substr(0, equals);
      const Value value = value_of_text(setting.substr(equals + 1));
      if (!values.emplace(name, value).second)
        throw UsageError("--set " + name + " is given twice, last as " + to_text(value) + ". Leave one out.");
    }
    return values;
  }

  /// Its step would refuse a report in the session's place too, after all that was measured for it.
  void demand_place_of_reports(const std::vector<Step>& steps) const {
    for (const Step& step : steps) {
      demand_place_of_reports(step.steps);
      const Node* file = step.kind->only_reports() ? step.options.find("file") : nullptr;
      if (!file || has_expression(file->scalar)) continue;
      const auto report = std::filesystem::absolute(out_).parent_path() / file->scalar;
      if (std::filesystem::weakly_canonical(report) == std::filesystem::weakly_canonical(out_))
        throw ProcedureError(file->position,
                             "the report would be written over the session " + out_ +
                                 ". Give --out another name, such as " +
                                 std::filesystem::path(out_).replace_extension(".rig").string() + ".");
    }
  }

  /// What a run would ask a person to confirm, before anything moves.
  int list_doubts(const fit::Bench& bench) const {
    const std::vector<std::string> doubts = doubts_about(bench);
    if (doubts.empty()) return 0;
    std::fputs("Implausible values of the bench file, which a run asks to confirm and --yes refuses:\n",
               stdout);
    for (const std::string& doubt : doubts) std::fprintf(stdout, "  %s\n", doubt.c_str());
    if (!devices_.yes) return 0;
    throw UsageError("with --yes this run would be refused. Correct the bench file, or leave --yes out.");
  }

  /// Found before the devices are touched. A file that is there is resumed, or refused by the session itself.
  void demand_place_to_write() const {
    std::error_code missing;
    const auto type = std::filesystem::status(out_, missing).type();
    if (type == std::filesystem::file_type::regular) return;
    (void)check_output({out_, "session.rig"});
  }

  bool continues() const {
    std::error_code missing;
    const auto size = std::filesystem::file_size(out_, missing);
    return resume_ && !missing && size > 0;
  }

  fit::Bench known_bench() const {
    std::optional<std::string> stored;
    if (continues()) stored = SessionStore(out_, SessionStore::Mode::read).get("bench");
    if (bench_.empty() && !stored) throw UsageError(bench_missing());
    if (bench_.empty()) return read_bench_text(*stored, out_ + " (its bench)");
    fit::Bench bench = read_bench_file(bench_);
    if (stored && json::parse(*stored) != json::parse(fit::to_json_text(bench)))
      throw UsageError(
          bench_ + " differs from the bench that " + out_ +
          " was begun with, so it cannot be resumed. Leave --bench out, or begin a new session.");
    return bench;
  }

  std::string bench_missing() const {
    if (continues())
      return out_ +
             " holds no bench: it ended before its run began. Give --bench FILE, the bench it runs on.";
    if (resume_)
      return "there is no session " + out_ +
             " to resume, and so no bench in it. Give the session's name with --out, or --bench FILE to "
             "begin "
             "one.";
    return "--bench is missing: the bench file says what stands where. `rig new bench FILE` writes a "
           "commented "
           "one.";
  }

  std::string procedure_, bench_, out_;
  std::vector<std::string> settings_;
  bool resume_ = false, dry_run_ = false;
  DeviceRun devices_;
};

}  // namespace

std::unique_ptr<Command> make_run() { return std::make_unique<Run>(); }

}  // namespace rig::commands
