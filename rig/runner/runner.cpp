// SPDX-License-Identifier: MIT
#include "rig/runner/runner.hpp"

#include <algorithm>
#include <boost/asio/experimental/awaitable_operators.hpp>
#include <filesystem>

#include "rig/runner/device_lock.hpp"
#include "rig/runner/runner_impl.hpp"

namespace rig {
namespace {

using namespace asio::experimental::awaitable_operators;

/// Where the lidar's clock is not the host's: before anything is measured, since such a run could not be
/// ended.
void refuse_turns(const std::vector<PlannedStep>& plan, const std::map<std::string, std::string>& recorded) {
  for (const PlannedStep& step : plan)
    if (step.step->kind->turns_stage() && !recorded.contains(step.key))
      throw UsageError(
          "A turning capture (step " + step.key +
          ") needs scans and stage positions on one clock, and the clocks of this lidar and this computer "
          "are unrelated. Nothing was measured. Run the simulator with --speed real.");
}

}  // namespace

Runner::Impl::Impl(Procedure procedure_, fit::Bench bench_, SessionStore& session_, RunnerParts parts_)
    : procedure(std::move(procedure_)),
      known_bench(std::move(bench_)),
      session(session_),
      parts(std::move(parts_)),
      plan(unroll(procedure, known_bench)),
      time(parts.clock),
      time_left(plan) {
  limits = stage_limits(known_bench);
  variables = procedure.variables;
  progress = session.progress();
  state.procedure = procedure.title;
  state.session = std::filesystem::path(session.path()).filename().string();
  state.session_path = session.path();
  for (const auto& step : plan) {
    state.steps.emplace_back(step.says, RunState::StepState::not_started);
    state.step_keys.push_back(step.key);
  }
  if (!plan.empty()) state.left_s = time_left.left_s(TimeLeft::Running());
  check_same_procedure();
  if (const auto epoch = session.get("epoch_unix_us")) time.go_on_from(std::stoll(*epoch));
}

awaitable<void> Runner::Impl::prepare() {
  describe_session();
  placed.restore(progress_of("scene"), progress_of("power_on_us"));
  remember_unchecked();
  co_await ask_about_bench();
  co_await await_lidar();
  const StageIdentity stage = co_await parts.stage.identify();
  // A simulated stage has the serial number of all of them.
  if (parts.locks && !lidar_is_simulated) parts.locks->lock_stage(stage.model, stage.serial);
  session.set("stage", json{{"language", stage.language},
                            {"model", stage.model},
                            {"serial", stage.serial},
                            {"firmware", stage.firmware},
                            {"units_per_deg", stage.units_per_deg}}
                           .dump());
  const StageStatus status = co_await stage_status();
  position_deg = status.position_deg;
  referenced = status.homed;
  if (status.moving) {
    note("warning", "the stage was found moving and was stopped");
    co_await stop_turning();
  }
  for (const auto& warning : status.warnings) note(status.homed ? "warning" : "info", "stage: " + warning);
  co_await compare_clocks();
  if (time.follows_lidar()) refuse_turns(plan, progress);
  co_await place_again();
}

void Runner::Impl::take_over(std::size_t index) {
  const json what = progress_of(plan[index].key);
  const json outputs_before = what.value("set", json::object());
  for (const auto& [name, value] : outputs_before.items()) variables[name] = value_of(value);
  if (what.contains("skip")) skipped_turns.insert(what["skip"].get<std::string>());
  if (what.contains("stage_deg")) resume_at = what;
  leave_out(index);
}

void Runner::Impl::leave_out(std::size_t index) {
  state.steps[index].second = RunState::StepState::recorded;
  time_left.over(index);
}

bool Runner::Impl::in_skipped_turn(std::size_t index) const {
  return std::ranges::any_of(plan[index].turns,
                             [&](const auto& turn) { return skipped_turns.count(turn) > 0; });
}

awaitable<void> Runner::Impl::return_to_place() {
  const json where = std::exchange(resume_at, json());
  if (!where.is_object()) co_return;
  if (where.value("homed", false)) {
    co_await home(false);
  }
  if (where.value("moved", false)) {
    const FilePosition place{procedure.file, plan[current].step->place.line,
                             plan[current].step->place.column};
    co_await move_to(where["stage_deg"].get<double>(), where.value("approach", 0), place);
  }
}

awaitable<void> Runner::Impl::run_step() {
  const PlannedStep& planned = plan[current];
  Variables visible = variables;
  for (const auto& [name, value] : planned.loop_variables) visible[name] = value;
  current_name = planned.step->name.empty() ? planned.step->kind->name() + " " + planned.key
                                            : to_text(evaluate_text(planned.step->name, visible));
  state.step = current;
  state.steps[current].second = RunState::StepState::running;
  step_begun_us = parts.clock.host_us();
  step_paused_us = 0;
  step_done_before = planned.captures > 0 ? static_cast<double>(captures_begun(planned)) /
                                                static_cast<double>(planned.captures)
                                          : 0;
  state.activity = planned.says;
  outputs = json::object();
  co_await checkpoint(0, 0);
  co_await return_to_place();
  const Arguments arguments(planned.step->options, planned.step->kind->options(), visible);
  co_await planned.step->kind->run(arguments, *this);
  if (planned.step->kind->homes_stage()) homed = true;
  if (position_deg != 0 || last_approach != 0) moved = true;
  json what = {{"set", outputs},
               {"stage_deg", position_deg},
               {"approach", last_approach},
               {"homed", homed},
               {"moved", moved}};
  if (!planned.turns.empty() && skipped_turns.count(planned.turns.back()))
    what["skip"] = planned.turns.back();
  if (!jump) record(planned.key, what);
  state.steps[current].second = RunState::StepState::recorded;
  time_left.over(running_step());
}

awaitable<void> Runner::Impl::run_steps() {
  co_await prepare();
  state.phase = RunState::Phase::running;
  for (current = 0; current < plan.size(); ++current) {
    if (recorded(plan[current].key)) {
      take_over(current);
      continue;
    }
    if (in_skipped_turn(current)) {
      leave_out(current);
      continue;
    }
    if (resume_at.is_object()) {
      homed = resume_at.value("homed", false);
      moved = resume_at.value("moved", false);
    }
    co_await run_step();
    if (jump) go_back();
  }
  current = plan.empty() ? 0 : plan.size() - 1;
}

void Runner::Impl::go_back() {
  const std::size_t target = *std::exchange(jump, std::nullopt);
  for (std::size_t i = target; i <= current; ++i) {
    if (state.steps[i].second == RunState::StepState::recorded) time_left.again(i);
    state.steps[i].second = RunState::StepState::not_started;
  }
  current = target - 1;  // The loop adds one; wraps to 0 from the first step.
}

awaitable<void> Runner::Impl::run_steps_quietly() {
  try {
    co_await run_steps();
  } catch (const boost::system::system_error& error) {
    // What was called off because of the operator is no failure of its own.
    if (!aborted || error.code() != asio::error::operation_aborted) failure = std::current_exception();
  } catch (...) {
    failure = std::current_exception();
  }
}

awaitable<void> Runner::Impl::stop_stage_when_aborted() {
  co_await abort_gate.wait();
  if (!aborted) co_return;
  try {
    co_await parts.stage.stop();
  } catch (const std::exception&) {
    // make_safe() tries again, and tells.
  }
}

awaitable<void> Runner::Impl::make_safe() {
  try {
    co_await parts.stage.stop();
  } catch (const std::exception&) {
    safe_problems += "The stage could not be stopped: check it.";
  }
  if (!connected) co_return;
  try {
    co_await parts.lidar.stop();
  } catch (const std::exception&) {
    safe_problems += safe_problems.empty() ? "" : " ";
    safe_problems += "The lidar could not be stopped: its laser may be on.";
  }
}

void Runner::Impl::store_limits() {
  if (procedure.limits.empty()) return;
  const json checked = check_limits(procedure.limits, session);
  session.add_result("limits", checked.dump());
  state.checks_text = checked["checks"].dump();
}

bool Runner::Impl::limits_met() const {
  for (const json& check : json::parse(state.checks_text))
    if (check.value("verdict", "") != "pass") return false;
  return true;
}

void Runner::Impl::conclude() {
  const bool stopped = aborted || (failure && is_stopped(failure));
  try {
    if (connected) record_lidar_statistics();
    if (!safe_problems.empty()) note("warning", safe_problems);
    if (failure || aborted)
      note(stopped ? "warning" : "error", aborted ? "stopped by the operator" : words_of(failure));
    session.set("ended", aborted ? "stopped by the operator" : failure ? words_of(failure) : "done");
    if (!failure && !aborted) {
      store_limits();
      note("info", "procedure finished");
      state.overall = 1;
      state.left_s = 0;
    }
  } catch (const std::exception&) {
    // The session cannot be written any more; the failure that follows says why.
  }
  finish_session();
  if (failure || aborted) state.ended = aborted ? "Stopped by the operator." : words_of(failure);
  state.phase = stopped   ? RunState::Phase::aborted
                : failure ? RunState::Phase::failed
                          : RunState::Phase::done;
  for (const auto& observer : observers) observer(state);
}

void Runner::Impl::finish_session() {
  try {
    session.finish();
  } catch (const std::exception& error) {
    if (!failure)
      failure = std::current_exception();
    else if (words_of(failure) != error.what())
      announce("error", error.what());
  }
}

bool Runner::Impl::is_stopped(const std::exception_ptr& why) { return is_a<RunStopped>(why); }

Runner::Runner(Procedure procedure, fit::Bench bench, SessionStore& session, RunnerParts parts)
    : impl_(std::make_unique<Impl>(std::move(procedure), std::move(bench), session, std::move(parts))) {}
Runner::~Runner() = default;

awaitable<bool> Runner::run() {
  Impl& impl = *impl_;
  auto working = impl.run_steps_quietly();
  auto stopping = impl.stop_stage_when_aborted();
  co_await (std::move(working) || std::move(stopping));
  co_await asio::this_coro::reset_cancellation_state(asio::disable_cancellation());
  co_await impl.make_safe();
  impl.conclude();
  if (impl.aborted && !impl.failure) impl.stop_if_aborted();
  if (impl.failure) std::rethrow_exception(impl.failure);
  co_return impl.limits_met();
}

void Runner::pause() {
  if (impl_->paused) return;
  impl_->paused = impl_->state.pausing = true;
  impl_->note("info", "pausing after the capture or move in progress");
}

void Runner::resume() {
  impl_->paused = impl_->state.pausing = false;
  impl_->resume_gate.open();
  impl_->changed();
}

void Runner::abort() {
  if (impl_->computing && !impl_->aborted)
    impl_->announce("warning",
                    "the computation cannot be interrupted: rig ends when it is done and discards it "
                    "(a second Ctrl-C ends rig at once; nothing captured is lost)");
  impl_->aborted = true;
  impl_->abort_gate.open();
  impl_->resume_gate.open();
  impl_->answer_gate.open();
}

void Runner::answer(const Answer& answer) {
  if (impl_->state.phase != RunState::Phase::prompt) return;
  if (answer.kind == Answer::Kind::abort) return abort();
  impl_->answered = answer;
  impl_->answer_gate.open();
}

void Runner::command(const json& command) {
  if (!command.is_object()) return;
  const std::string word = command.value("command", "");
  if (word == "pause") return pause();
  if (word == "resume") return resume();
  if (word == "abort" || word == "stop-now") return abort();
  Answer given;
  if (word == "confirm") {
    if (command.contains("answer") && command["answer"].is_number())
      given.value = command["answer"].get<double>();
    if (command.contains("answer") && command["answer"].is_string())
      given.value = value_of_text(command["answer"].get<std::string>());
    return answer(given);
  }
  if (word == "skip") given.kind = Answer::Kind::skipped;
  if (word == "repeat") given.kind = Answer::Kind::repeat;
  if (word == "skip" || word == "repeat") answer(given);
}

void Runner::observe(Observer observer) { impl_->observers.push_back(std::move(observer)); }
const RunState& Runner::state() const { return impl_->state; }
const std::vector<PlannedStep>& Runner::plan() const { return impl_->plan; }

}  // namespace rig
