// SPDX-License-Identifier: MIT
#include <algorithm>
#include <span>

#include "fit/numeric/number_format.hpp"
#include "rig/runner/bench_doubts.hpp"
#include "rig/runner/runner_impl.hpp"

namespace rig {
namespace {

constexpr int attempts_of_nobody = 3;  // A simulated bench that placed it wrongly three times will not learn.

/// For a number with a decimal comma or a unit: the same as the rig reads it.
std::string how_to_write(const Answer& answer) {
  const auto* text = answer.value ? std::get_if<std::string>(&*answer.value) : nullptr;
  if (!text) return "";
  std::string plain = *text;
  std::ranges::replace(plain, ',', '.');
  const std::string number = plain.substr(0, plain.find_first_not_of("+-.0123456789"));
  const std::string rest = plain.substr(number.size());
  const Value value = value_of_text(number);
  const bool is_unit = std::ranges::none_of(rest, [](char c) { return c == '.' || (c >= '0' && c <= '9'); });
  if (!is_unit || !std::holds_alternative<double>(value)) return "";
  return ": write " + number + ", with a decimal point and without a unit";
}

/// Why an answer is none to the prompt's question; empty if it is one. What was not answered takes the
/// question's own.
std::string wrong_answer(const Prompt& prompt, Answer& answer) {
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
  if (!number) return "the answer must be " + wanted + how_to_write(answer) + ".";
  if ((question.min && *number < *question.min) || (question.max && *number > *question.max))
    return fit::with_unit(to_text(*number), question.unit) +
           (question.min && question.max ? " is outside " + to_text(*question.min) + " to " + with_max
            : question.min ? " is below " + fit::with_unit(to_text(*question.min), question.unit)
                           : " is above " + with_max) +
           ".";
  return "";
}

}  // namespace

awaitable<Answer> Runner::Impl::ask(Prompt prompt) {
  const auto before = state().phase;
  observer.expect(prompt);
  for (int attempt = 1;; ++attempt) {
    state().phase = RunState::Phase::prompt;
    prompt.number = ++prompts_asked;
    state().prompt = prompt;
    state().activity = "prompt: " + prompt.title;
    note("info", "asks: " + prompt.title);
    store_waiting_prompt(prompt);
    Answer answer = co_await ask_once(prompt);
    session.set("waiting", "");
    state().prompt.reset();
    state().phase = before;
    if (answer.kind == Answer::Kind::abort) control.abort_at_prompt();
    control.stop_if_aborted();
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
    if (parts.operator_.unattended() && attempt >= attempts_of_nobody)
      throw MeasurementError("'" + prompt.title + "' is not as requested: " + prompt.refusal +
                             " Unattended run: cannot be corrected.");
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
  Expectation expected = *prompt.until;
  if (expected.of_target && !observer.can_see(*expected.target)) {
    observer.check_later(expected);
    note("info",
         "'" + expected.target->name + "' is not in view from here; it is checked before it is measured");
    if (!expected.of_beams) co_return "";
    expected.of_target = false;
  }
  const Observation observed = co_await observer.observe(expected);
  if (!observed.good) co_return observed.text;
  if (!expected.of_target) co_return "";
  observer.checked(expected.target->name);
  co_return observer.wrong_surface(expected, observed);
}

awaitable<Answer> Runner::Impl::ask_once(Prompt prompt) {
  desk.open();
  auto watching = watch.watch(prompt.until);
  co_await desk.wait(prompt, std::move(watching));
  co_await watch.end();
  control.stop_if_aborted();
  const std::optional<Answer> answered = desk.taken();
  if (!answered)
    throw RunStopped("Nobody answered '" + prompt.title + "' in " + duration_text(prompt.timeout_s) + ".");
  co_return *answered;
}

awaitable<void> Runner::Impl::apply(const Prompt& prompt) {
  if (!prompt.place) co_return;
  const Placement place = *prompt.place;
  placed.place(place, time.now_us());
  progress.record("scene", placed.placements_json());
  if (!place.since_power_on_s) co_return;
  progress.record("power_on_us", *placed.power_on_us());
  co_await lidar_link.reconnect_after_power_cycle();
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

awaitable<void> Runner::Impl::check_targets() {
  for (const Expectation& expected : observer.to_check_here()) {
    const Observation observed = co_await observer.observe(expected);
    observer.checked(expected.target->name);
    if (observed.good) continue;
    note("warning", observed.text);
    if (parts.doubts_bench) continue;
    if (parts.operator_.unattended())
      throw MeasurementError(
          observed.text +
          " Unattended run: cannot be corrected. Put it there, or correct from_mm and to_mm in "
          "the bench file and begin a new session.");
    Prompt prompt;
    prompt.title = "Put '" + expected.target->name + "' in its place";
    prompt.text =
        "Its distance from the stage's axis is to be " + rounded_text(distance_mm(*expected.target), 1) +
        " mm. If it stands as it should, stop the run and correct from_mm and to_mm in the bench file.";
    prompt.check = observed.text;
    prompt.until = expected;
    prompt.skippable = prompt.repeatable = false;
    co_await ask(prompt);
  }
}

awaitable<void> Runner::Impl::ask_about_bench() {
  if (session.get("bench_confirmed")) co_return;
  const std::vector<std::string> doubts = doubts_about(known_bench);
  if (doubts.empty()) co_return;
  std::string text;
  for (const std::string& doubt : doubts) text += (text.empty() ? "" : " ") + doubt;
  if (parts.operator_.unattended())
    throw UsageError("The bench file has implausible values. " + text +
                     " Nothing was moved. Correct the bench file, or stay and confirm them (without --yes).");
  Prompt prompt;
  prompt.title = "The bench file has implausible values. Are they right?";
  prompt.text = text + " Nothing has moved yet. Confirm them, or stop and correct the bench file.";
  prompt.skippable = prompt.repeatable = false;
  co_await ask(prompt);
  session.set("bench_confirmed", text);
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
  progress.forget(std::span(plan).subspan(first, current - first));
  skipped_turns.erase(turn);
  jump = first;
  note("info", "repeats " + turn);
  return true;
}

}  // namespace rig
