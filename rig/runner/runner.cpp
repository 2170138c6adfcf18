// SPDX-License-Identifier: MIT
#include "rig/runner/runner.hpp"

#include <algorithm>
#include <boost/asio/experimental/awaitable_operators.hpp>
#include <filesystem>

#include "rig/json_fields.hpp"
#include "rig/runner/device_lock.hpp"
#include "rig/runner/runner_impl.hpp"
#include "rig/session/session_dates.hpp"

namespace rig {
namespace {

using namespace asio::experimental::awaitable_operators;

const std::string stage_stands = "The stage has stopped.";

/// Where the lidar's clock is not the host's: before anything is measured, since such a run could not be
/// ended.
void refuse_turns(const std::vector<PlannedStep>& plan, const RunProgress& progress) {
  for (const PlannedStep& step : plan)
    if (step.step->kind->turns_stage() && !progress.has(step.key))
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
      variables(procedure.variables),
      time(parts.clock),
      control(session),
      status(plan, session, time, parts.clock, parts.lidar),
      progress(session),
      stage(parts.stage, parts.clock, procedure.stage, stage_limits(known_bench), status, control),
      lidar_link(parts, known_bench, session, time, placed, status, control),
      observer(known_bench, plan, variables, placed, lidar_link, stage),
      desk(parts.operator_, parts.clock),
      watch(parts.operator_, known_bench.lidar, parts.clock, time, observer, desk, lidar_link, status,
            control) {
  state().procedure = procedure.title;
  check_same_procedure();
  if (const auto epoch = session.get("epoch_unix_us")) {
    const auto begun_us = epoch_unix_us(session);
    if (!begun_us)
      throw UsageError(
          session.path() + " is damaged: it says '" + *epoch +
          "' of when it began, so that nothing can be added at the right time. Nothing was moved. "
          "Begin a new session.");
    time.go_on_from(*begun_us);
  }
}

awaitable<void> Runner::Impl::prepare() {
  describe_session();
  placed.restore(progress.of("scene"), progress.of("power_on_us"));
  observer.remember_unchecked();
  co_await ask_about_bench();
  co_await lidar_link.await_first();
  const StageIdentity found = co_await parts.stage.identify();
  // A simulated stage has the serial number of all of them.
  if (parts.locks && !lidar_link.simulated()) parts.locks->lock_stage(found.model, found.serial);
  demand_same_stage(found);
  session.set("stage", json{{"language", found.language},
                            {"model", found.model},
                            {"serial", found.serial},
                            {"firmware", found.firmware},
                            {"units_per_deg", found.units_per_deg}}
                           .dump());
  co_await stage.find();
  co_await lidar_link.compare_clocks();
  if (time.follows_lidar()) refuse_turns(plan, progress);
  co_await place_again();
}

void Runner::Impl::demand_same_stage(const StageIdentity& found) const {
  const json known = json::parse(session.get("stage").value_or("null"), nullptr, false);
  if (!known.is_object()) return;
  const std::string model = text_of(known, "model"), serial = text_of(known, "serial");
  if (model == found.model && serial == found.serial) return;
  const auto named = [](const std::string& model_, const std::string& serial_) {
    return model_ + (serial_.empty() ? "" : " " + serial_);
  };
  throw DeviceError(
      "This is another stage (" + named(found.model, found.serial) +
      ") than the one the session was begun with (" + named(model, serial) +
      "), whose zero and scale are its own. Nothing was moved. Connect that one, or begin a new "
      "session.");
}

void Runner::Impl::take_over(std::size_t index) {
  const json what = progress.of(plan[index].key);
  const json outputs_before = what.value("set", json::object());
  for (const auto& [name, value] : outputs_before.items()) variables[name] = value_of(value);
  if (what.contains("skip")) skipped_turns.insert(what["skip"].get<std::string>());
  if (what.contains("stage_deg")) resume_at = what;
  status.leave_out(index);
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
    const FilePosition position{procedure.file, plan[current].step->position.line,
                                plan[current].step->position.column};
    co_await move_to(where["stage_deg"].get<double>(), where.value("approach", 0), position);
  }
}

awaitable<void> Runner::Impl::run_step() {
  const PlannedStep& planned = plan[current];
  Variables visible = variables;
  for (const auto& [name, value] : planned.loop_variables) visible[name] = value;
  current_name = planned.step->name.empty() ? planned.step->kind->name() + " " + planned.key
                                            : to_text(evaluate_text(planned.step->name, visible));
  const double done_before = planned.captures > 0 ? static_cast<double>(progress.captures_begun(planned)) /
                                                        static_cast<double>(planned.captures)
                                                  : 0;
  status.begin_step(current, done_before);
  outputs = json::object();
  co_await checkpoint(0, 0);
  co_await return_to_place();
  const Arguments arguments(planned.step->options, planned.step->kind->options(), visible);
  co_await planned.step->kind->run(arguments, *this);
  if (planned.step->kind->homes_stage()) homed = true;
  if (stage.deg() != 0 || stage.approach() != 0) moved = true;
  json what = {{"set", outputs},
               {"stage_deg", stage.deg()},
               {"approach", stage.approach()},
               {"homed", homed},
               {"moved", moved}};
  if (!planned.turns.empty() && skipped_turns.count(planned.turns.back()))
    what["skip"] = planned.turns.back();
  if (!jump) progress.record(planned.key, what);
  status.finish_step();
}

awaitable<void> Runner::Impl::run_steps() {
  co_await prepare();
  state().phase = RunState::Phase::running;
  for (current = 0; current < plan.size(); ++current) {
    if (recorded(plan[current].key)) {
      take_over(current);
      continue;
    }
    if (in_skipped_turn(current)) {
      status.leave_out(current);
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
  status.begin_again(target, current);
  current = target - 1;  // The loop adds one; wraps to 0 from the first step.
}

awaitable<void> Runner::Impl::run_steps_quietly() {
  try {
    co_await run_steps();
  } catch (const boost::system::system_error& error) {
    // What was called off because of the operator is no failure of its own.
    if (!control.aborted() || error.code() != asio::error::operation_aborted)
      failure = std::current_exception();
  } catch (...) {
    failure = std::current_exception();
  }
}

awaitable<void> Runner::Impl::stop_stage_when_aborted() {
  co_await control.until_aborted();
  if (!control.aborted()) co_return;
  try {
    co_await parts.stage.stop();
  } catch (const std::exception&) {
    // make_safe() tries again, and reports.
  }
}

awaitable<void> Runner::Impl::make_safe() {
  try {
    co_await parts.stage.stop();
    made_safe = stage_stands;
  } catch (const std::exception&) {
    safe_problems += "The stage could not be stopped: check it.";
  }
  if (!lidar_link.connected()) co_return;
  try {
    co_await parts.lidar.stop();
    if (failure && is_lidar_lost(failure)) co_return;  // Nothing was sent to it.
    made_safe += made_safe.empty() ? "" : " ";
    made_safe += "The lidar's laser is off.";
  } catch (const std::exception&) {
    safe_problems += safe_problems.empty() ? "" : " ";
    safe_problems += "The lidar could not be stopped: its laser may be on.";
  }
}

void Runner::Impl::conclude() {
  const bool stopped = control.aborted() || (failure && is_a<RunStopped>(failure));
  try {
    if (lidar_link.connected()) lidar_link.record_statistics();
    if (!safe_problems.empty()) note("warning", safe_problems);
    if (failure || control.aborted())
      note(stopped ? "warning" : "error", control.aborted() ? "stopped by the operator" : words_of(failure));
    session.set("ended", control.aborted() ? "stopped by the operator"
                         : failure         ? words_of(failure)
                                           : "done");
    if (!failure && !control.aborted()) {
      store_limits();
      note("info", "procedure finished");
      state().overall = 1;
      state().left_s = 0;
    }
  } catch (const std::exception&) {
    // The session cannot be written any more; the failure that follows says why.
  }
  finish_session();
  // A stage's fault may have said it already.
  const std::string why = failure ? words_of(failure) : "";
  const bool said =
      why.find(stage_stands) != std::string::npos || why.find("Nothing was moved.") != std::string::npos;
  if (said && made_safe.starts_with(stage_stands)) made_safe.erase(0, stage_stands.size());
  if (made_safe.starts_with(" ")) made_safe.erase(0, 1);
  if (failure) failure = with_more_words(failure, made_safe);
  if (failure && words_of(failure).find("rig resume") == std::string::npos)
    failure = with_more_words(failure, control.how_to_go_on());
  if (failure || control.aborted())
    state().ended = control.aborted() ? "Stopped by the operator. " + made_safe : words_of(failure);
  state().phase = stopped   ? RunState::Phase::aborted
                  : failure ? RunState::Phase::failed
                            : RunState::Phase::done;
  status.changed();
}

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
  if (!impl.failure) impl.control.stop_if_aborted(impl.made_safe);
  if (impl.failure) std::rethrow_exception(impl.failure);
  co_return impl.limits_met();
}

void Runner::pause() {
  if (impl_->control.paused()) return;
  impl_->control.pause();
  impl_->state().pausing = true;
  impl_->note("info", "pausing after the capture or move in progress");
}

void Runner::resume() {
  impl_->control.resume();
  impl_->state().pausing = false;
  impl_->status.changed();
}

void Runner::abort() {
  if (impl_->worker.computing() && !impl_->control.aborted())
    impl_->status.announce("warning",
                           "the computation cannot be interrupted: rig ends when it is done and discards it "
                           "(a second Ctrl-C ends rig at once; nothing captured is lost)");
  impl_->control.abort();
  impl_->desk.close();
}

void Runner::answer(const Answer& answer) {
  if (impl_->state().phase != RunState::Phase::prompt) return;
  if (answer.kind == Answer::Kind::abort) return abort();
  impl_->desk.answer(answer);
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

void Runner::observe(Observer observer) { impl_->status.observe(std::move(observer)); }
const RunState& Runner::state() const { return impl_->state(); }
const std::vector<PlannedStep>& Runner::plan() const { return impl_->plan; }

}  // namespace rig
