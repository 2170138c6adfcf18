// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "rig/runner/runner_impl.hpp"

namespace rig {
namespace {

/// "samples was 1000 and is 500 now, ..."; empty if nothing differs.
std::string different_values(const json& before, const json& now) {
  std::string text;
  const auto add = [&](const std::string& words) { text += (text.empty() ? "" : ", ") + words; };
  for (const auto& [name, value] : before.items())
    if (!now.contains(name))
      add(name + " was " + to_text(rig::value_of(value)) + " and is missing now");
    else if (now[name] != value)
      add(name + " was " + to_text(rig::value_of(value)) + " and is " + to_text(rig::value_of(now[name])) +
          " now");
  for (const auto& [name, value] : now.items())
    if (!before.contains(name)) add(name + " was not set and is " + to_text(rig::value_of(value)) + " now");
  return text;
}

}  // namespace

json json_of(const Value& value) {
  if (const auto* number = std::get_if<double>(&value)) return *number;
  if (const auto* flag = std::get_if<bool>(&value)) return *flag;
  if (const auto* text = std::get_if<std::string>(&value)) return *text;
  return nullptr;
}

Value value_of(const json& stored) {
  if (stored.is_number()) return stored.get<double>();
  if (stored.is_boolean()) return stored.get<bool>();
  if (stored.is_string()) return stored.get<std::string>();
  return Unknown{};
}

void Runner::Impl::check_same_procedure() {
  const auto stored = session.get("procedure");
  if (!stored) return;
  if (*stored != procedure.text)
    throw UsageError(procedure.file + " differs from the procedure that " + session.path() +
                     " was begun with, so it cannot be resumed. `rig resume " + session.path() +
                     "` continues with the procedure that is in it; or begin a new session.");
  const json before = json::parse(session.get("variables").value_or("null"), nullptr, false);
  const std::string differ = before.is_object() ? different_values(before, variables_json()) : "";
  if (!differ.empty())
    throw UsageError(session.path() + " was begun with other variables, so it cannot be resumed: " + differ +
                     ". `rig resume " + session.path() + "` takes them from it; or begin a new session.");
}

json Runner::Impl::variables_json() const {
  json all = json::object();
  for (const auto& [name, value] : procedure.variables) all[name] = json_of(value);
  return all;
}

void Runner::Impl::describe_session() {
  if (!session.get("steps")) session.set("steps", steps_json().dump());
  session.set("ended", "");
  if (session.get("procedure")) {
    note("info", resumed_words());
    return;
  }
  session.set("bench", fit::to_json_text(known_bench));
  session.set("procedure", procedure.text);
  session.set("procedure_name", procedure.title);
  session.set("procedure_file", procedure.file);
  session.set("kind", procedure.name);
  session.set("variables", variables_json().dump());
  session.set("epoch_unix_us", std::to_string(time.begun_unix_us()));
}

std::string Runner::Impl::resumed_words() const {
  long captures = 0, done = 0;
  const PlannedStep* next = nullptr;
  std::set<std::string> skipped;
  Variables known;
  for (const PlannedStep& step : plan) {
    const json what = progress.of(step.key);
    const bool left_out =
        std::ranges::any_of(step.turns, [&](const auto& turn) { return skipped.count(turn) > 0; });
    if (!left_out) captures += step.captures;
    if (what.is_object()) {
      done += step.captures;
      if (what.contains("skip")) skipped.insert(what["skip"].get<std::string>());
      const json set_by_it = what.value("set", json::object());
      for (const auto& [name, value] : set_by_it.items()) known[name] = value_of(value);
    } else if (!next && !left_out) {
      next = &step;
    }
  }
  if (!next)
    return "resumed: all " + grouped(captures) + " captures and all " + std::to_string(plan.size()) +
           " steps are done already";
  done += progress.captures_begun(*next);
  for (const auto& [name, value] : next->loop_variables) known[name] = value;
  std::string text = "resumed: " + grouped(done) + " of " + grouped(captures) +
                     " captures are done; next is step " + std::to_string(next - plan.data() + 1) + " of " +
                     std::to_string(plan.size()) + ", " + next->says;
  for (const auto& [name, value] : known)
    text += (name == known.begin()->first ? ", with " : ", ") + name + " = " + to_text(value);
  return text;
}

json Runner::Impl::steps_json() const {
  json steps = json::array();
  for (const PlannedStep& step : plan) steps.push_back({{"key", step.key}, {"text", step.says}});
  return steps;
}

void Runner::Impl::store_limits() {
  if (procedure.limits.empty()) return;
  const json checked = check_limits(procedure.limits, session);
  session.add_result("limits", checked.dump());
  state().checks_text = checked["checks"].dump();
}

bool Runner::Impl::limits_met() const { return all_pass(json::parse(state().checks_text)); }

void Runner::Impl::finish_session() {
  try {
    session.finish();
  } catch (const std::exception& error) {
    if (!failure)
      failure = std::current_exception();
    else if (words_of(failure) != error.what())
      status.announce("error", error.what());
  }
}

}  // namespace rig
