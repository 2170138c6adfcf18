// SPDX-License-Identifier: MIT
#include <boost/asio/experimental/awaitable_operators.hpp>

#include "fit/number_format.hpp"
#include "rig/runner/runner_impl.hpp"

namespace rig {
namespace {

using namespace asio::experimental::awaitable_operators;

constexpr int looks_of_nobody = 3;  // A simulated bench that placed it wrongly three times will not learn.

}  // namespace

awaitable<Answer> Runner::Impl::ask(Prompt prompt) {
  const auto before = state.phase;
  expect(prompt);
  for (int attempt = 1;; ++attempt) {
    state.phase = RunState::Phase::prompt;
    prompt.number = ++prompts_asked;
    state.prompt = prompt;
    state.activity = "prompt: " + prompt.title;
    note("info", "asks: " + prompt.title);
    store_waiting_prompt(prompt);
    Answer answer = co_await ask_once(prompt);
    session.set("waiting", "");
    state.prompt.reset();
    state.phase = before;
    aborted = aborted || answer.kind == Answer::Kind::abort;
    stop_if_aborted();
    if (answer.kind == Answer::Kind::skipped && prompt.skippable) {
      note("info", "skipped: " + prompt.title);
      co_return answer;
    }
    if (answer.kind == Answer::Kind::repeat && prompt.repeatable && repeat_previous_turn()) co_return answer;
    if (answer.kind != Answer::Kind::confirmed) {
      prompt.refusal = answer.kind == Answer::Kind::repeat ? "there is no earlier prompt to repeat."
                                                           : "this may not be skipped.";
      continue;
    }
    prompt.refusal = wrong_answer(prompt, answer);
    prompt.check.clear();
    const bool answered_well = prompt.refusal.empty();
    if (answered_well) {
      co_await apply(prompt);
      prompt.check = prompt.refusal = co_await check_after(prompt);
    }
    if (prompt.refusal.empty()) {
      note("info", "done: " + prompt.title);
      co_return answer;
    }
    note("warning", prompt.title + ": " + prompt.refusal);
    if (answered_well && parts.doubts_bench) {
      if (attempt > 1) co_return answer;
      prompt.refusal += " If it stands as requested, confirm again: the bench file may be wrong.";
    }
    if (parts.operator_.unattended() && attempt >= looks_of_nobody)
      throw MeasurementError(
          "'" + prompt.title + "' is not as requested: " + prompt.refusal +
          " Unattended run: cannot be corrected. The stage has stopped; continue with rig resume.");
  }
}

void Runner::Impl::store_waiting_prompt(const Prompt& prompt) {
  if (parts.operator_.unattended()) return;
  session.set("waiting", json{{"title", prompt.title},
                              {"text", prompt.text},
                              {"since_unix_s", parts.clock.unix_us() / 1'000'000}}
                             .dump(-1, ' ', false, json::error_handler_t::replace));
}

awaitable<std::string> Runner::Impl::check_after(const Prompt& prompt) {
  if (!prompt.until) co_return "";
  const Expectation expected = *prompt.until;
  if (expected.of_target && !can_see(*expected.target)) {
    unchecked[expected.target->name] = expected;
    note("info",
         "'" + expected.target->name + "' is not in view from here; it is checked before it is measured");
    co_return "";
  }
  const Observation observed = co_await observe(expected);
  if (!observed.good) co_return observed.text;
  if (!expected.of_target) co_return "";
  unchecked.erase(expected.target->name);
  co_return wrong_surface(expected, observed);
}

awaitable<Answer> Runner::Impl::ask_once(Prompt prompt) {
  answered.reset();
  answer_gate.close();
  auto asking = ask_operator(prompt);
  auto elsewhere = answer_gate.wait();
  auto late = prompt.timeout_s > 0 ? pause_for(prompt.timeout_s) : never();
  auto watching = watch_bench(prompt.until);
  co_await (std::move(asking) || std::move(elsewhere) || std::move(late) || std::move(watching));
  co_await end_watch();
  stop_if_aborted();
  if (operator_failed) std::rethrow_exception(std::exchange(operator_failed, nullptr));
  if (!answered)
    throw RunStopped("Nobody answered '" + prompt.title + "' in " + duration_text(prompt.timeout_s) +
                     ". The stage has stopped, and what was captured is in " + session.path() +
                     ". Continue with rig resume.");
  co_return *answered;
}

awaitable<void> Runner::Impl::ask_operator(Prompt prompt) {
  try {
    const Answer given = co_await parts.operator_.ask(prompt);
    if (!answered) answered = given;
  } catch (const boost::system::system_error& error) {
    // Called off, because the answer came from elsewhere or none came in time, is no failure.
    if (!answered && error.code() != asio::error::operation_aborted)
      operator_failed = std::current_exception();
  } catch (...) {
    if (!answered) operator_failed = std::current_exception();
  }
}

std::string Runner::Impl::wrong_answer(const Prompt& prompt, Answer& answer) {
  if (!prompt.question) return "";
  const Question& question = *prompt.question;
  if (!answer.value) answer.value = question.otherwise;
  const auto* number = answer.value ? std::get_if<double>(&*answer.value) : nullptr;
  const std::string wanted =
      "a number" + (question.unit.empty() ? "" : " in " + question.unit) +
      (question.min ? " of at least " + to_text(*question.min) : "") +
      (question.max ? (question.min ? " and" : " of") + (" at most " + to_text(*question.max)) : "");
  const std::string with_max =
      question.max ? fit::with_unit(to_text(*question.max), question.unit) : std::string();
  if (!number) return "the answer must be " + wanted + ".";
  if ((question.min && *number < *question.min) || (question.max && *number > *question.max))
    return fit::with_unit(to_text(*number), question.unit) +
           (question.min && question.max ? " is outside " + to_text(*question.min) + " to " + with_max
            : question.min ? " is below " + fit::with_unit(to_text(*question.min), question.unit)
                           : " is above " + with_max) +
           ".";
  return "";
}

awaitable<void> Runner::Impl::apply(const Prompt& prompt) {
  if (!prompt.place) co_return;
  const Placement place = *prompt.place;
  placed.place(place, time.now_us());
  record("scene", placed.placements_json());
  if (!place.since_power_on_s) co_return;
  record("power_on_us", *placed.power_on_us());
  streaming = false;
  power_cycle_announced = true;
  note("info", "the lidar was switched off and on: the rig is reconnecting");
  co_await connect_again(nullptr);
}

awaitable<void> Runner::Impl::place_again() {
  if (!parts.operator_.unattended()) co_return;
  for (const auto& [target, place] : placed.placements()) {
    Prompt prompt;
    prompt.title = "put back " + (target.empty() ? "the temperature" : target);
    prompt.place = place;
    co_await parts.operator_.ask(prompt);
  }
}

bool Runner::Impl::repeat_previous_turn() {
  const PlannedStep& here = plan[current];
  if (here.turns.empty()) return false;
  std::optional<std::size_t> previous;
  for (std::size_t i = current; i-- > 0;)
    if (plan[i].turns.size() == here.turns.size() && plan[i].turns.back() != here.turns.back()) {
      previous = i;
      break;
    }
  if (!previous) return false;
  const std::string turn = plan[*previous].turns.back();
  std::size_t first = *previous;
  while (first > 0 && !plan[first - 1].turns.empty() && plan[first - 1].turns.back() == turn) --first;
  std::vector<std::string> parts_done;
  std::vector<std::int64_t> captures;
  for (std::size_t i = first; i < current; ++i)
    for (const auto& [part, text] : progress)
      if (part == plan[i].key || part.starts_with(plan[i].key + "/")) {
        parts_done.push_back(part);
        const json what = json::parse(text, nullptr, false);
        if (what.is_object() && what.contains("capture"))
          captures.push_back(what["capture"].get<std::int64_t>());
      }
  session.forget_progress(parts_done, captures);
  for (const auto& part : parts_done) progress.erase(part);
  skipped_turns.erase(turn);
  jump = first;
  note("info", "repeats " + turn);
  return true;
}

}  // namespace rig
