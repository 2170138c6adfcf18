// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "rig/runner/runner_impl.hpp"

namespace rig {
namespace {

constexpr std::size_t messages_kept = 100;

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
    const json what = progress_of(step.key);
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
  done += captures_begun(*next);
  for (const auto& [name, value] : next->loop_variables) known[name] = value;
  std::string text = "resumed: " + grouped(done) + " of " + grouped(captures) +
                     " captures are done; next is step " + std::to_string(next - plan.data() + 1) + " of " +
                     std::to_string(plan.size()) + ", " + next->says;
  for (const auto& [name, value] : known)
    text += (name == known.begin()->first ? ", with " : ", ") + name + " = " + to_text(value);
  return text;
}

long Runner::Impl::captures_begun(const PlannedStep& step) const {
  const auto whole = std::ranges::count_if(progress, [&](const auto& part) {
    return part.first.starts_with(step.key + "/") && !part.first.ends_with("/short") &&
           part.second.find("\"capture\"") != std::string::npos;
  });
  return std::min<long>(whole, step.captures);  // A search may have taken more than it was planned with.
}

json Runner::Impl::steps_json() const {
  json steps = json::array();
  for (const PlannedStep& step : plan) steps.push_back({{"key", step.key}, {"text", step.says}});
  return steps;
}

json Runner::Impl::progress_of(const std::string& part) const {
  const auto found = progress.find(part);
  if (found == progress.end()) return nullptr;
  return json::parse(found->second, nullptr, false);
}

void Runner::Impl::record(const std::string& part, const json& what) {
  session.set_progress(part, what.dump());
  progress[part] = what.dump();
}

awaitable<void> Runner::Impl::checkpoint(long done, long total) {
  state.done = done;
  state.total = total;
  if (total > 0) state.unit = "stops";
  changed();
  stop_if_aborted();
  if (!paused) co_return;
  resume_gate.close();
  note("info", "paused");
  const auto before = state.phase;
  state.phase = RunState::Phase::paused;
  state.pausing = false;
  changed();
  const std::int64_t paused_us = parts.clock.host_us();
  co_await resume_gate.wait();
  step_paused_us += parts.clock.host_us() - paused_us;
  state.phase = before;
  stop_if_aborted();
  note("info", "resumed by the operator");
}

void Runner::Impl::set(const std::string& variable, const Value& value) {
  variables[variable] = value;
  outputs[variable] = json_of(value);
}

void Runner::Impl::skip_rest_of_iteration() {
  if (!plan[current].turns.empty()) skipped_turns.insert(plan[current].turns.back());
}

awaitable<json> Runner::Impl::fit(std::string kind, json options) {
  if (!parts.fit) throw UsageError("this program cannot fit '" + kind + "' yet.");
  state.activity = "fit " + kind;
  changed();
  session.demand_name();  // The worker opens the file by its name: a connection belongs to one thread.
  auto computing_it = compute([fit = parts.fit, file = session.path(), kind, options = std::move(options)] {
    const SessionStore recorded_so_far(file, SessionStore::Mode::read);
    return fit(kind, recorded_so_far, options);
  });
  json result = co_await std::move(computing_it);
  session.add_result(kind, result.dump(-1, ' ', false, json::error_handler_t::replace));
  session.demand_name();
  if (!procedure.limits.empty()) state.checks_text = check_limits(procedure.limits, session)["checks"].dump();
  changed();
  co_return result;
}

awaitable<void> Runner::Impl::report(std::string file) {
  if (!parts.report) throw UsageError("this program cannot write reports yet.");
  std::string target = report_target(file);
  state.activity = "report to " + file;
  store_limits();
  changed();
  session.demand_name();  // The report is made from the file.
  auto writing = compute([report = parts.report, session_file = session.path(), target] {
    return report(session_file, target);
  });
  const RunnerParts::Written written = co_await std::move(writing);
  if (!written.certificates.empty()) session.set("certificates", written.certificates);
  if (!written.file.empty() && written.file != target)
    note("warning", target + " is another certificate and was kept");
  note("info", "report written to " + (written.file.empty() ? target : written.file));
  state.report = written.file.empty() ? target : written.file;
}

std::string Runner::Impl::report_target(const std::string& file) const {
  const auto folder = std::filesystem::absolute(session.path()).parent_path();
  const auto target = folder / file;
  // Links are followed before it is judged where the report would go.
  const auto inside = std::filesystem::weakly_canonical(folder),
             really = std::filesystem::weakly_canonical(target);
  const bool leaves = std::ranges::mismatch(inside, really).in1 != inside.end();
  if (leaves || std::filesystem::is_symlink(target))
    throw UsageError(
        "the report '" + file + "' would be written to " + really.string() +
        ", outside the session's folder " + inside.string() +
        ". It was not written; what was measured is in the session. Remove the link, or use rig report.");
  return target.string();
}

void Runner::Impl::for_each_scan(std::int64_t capture,
                                 const std::function<void(const fit::ScanView&)>& visit) const {
  session.for_each_scan(capture, visit);
}

TimeLeft::Running Runner::Impl::running_step() const {
  TimeLeft::Running now;
  now.step = current;
  now.from = step_done_before;
  now.done = state.total > 0 ? static_cast<double>(state.done) / static_cast<double>(state.total) : 0;
  now.passed_s = static_cast<double>(parts.clock.host_us() - step_begun_us - step_paused_us) / 1e6;
  return now;
}

void Runner::Impl::estimate_time_left() {
  const TimeLeft::Running now = running_step();
  // Between steps the last one is over already.
  const bool runs = state.steps[current].second == RunState::StepState::running;
  if (!runs) return;
  state.overall = time_left.share(now);
  state.left_s = time_left.left_s(now);
}

void Runner::Impl::changed() {
  if (!plan.empty() && current < plan.size()) estimate_time_left();
  state.stage_deg = position_deg;
  state.scans_lost = parts.lidar.lost();
  state.scans_rejected = parts.lidar.rejected();
  for (const auto& observer : observers) observer(state);
}

void Runner::Impl::note(const std::string& level, const std::string& text) {
  session.add_event(time.now_us(), level, text);
  announce(level, text);
}

void Runner::Impl::announce(const std::string& level, const std::string& text) {
  state.messages.push_back({time.now_us(), level, text});
  ++state.messages_total;
  if (state.messages.size() > messages_kept) state.messages.erase(state.messages.begin());
  changed();
}

void Runner::Impl::stop_if_aborted() const {
  if (aborted)
    throw RunStopped("Stopped by the operator. The stage has stopped, the lidar's laser is off, and " +
                     (session.progress().empty() ? "nothing was captured yet."
                                                 : "what was captured is in " + session.path() +
                                                       ". Continue with: rig resume " + session.path()));
}

}  // namespace rig
