// SPDX-License-Identifier: MIT
#include <boost/asio/experimental/awaitable_operators.hpp>

#include "rig/runner/runner_impl.hpp"

namespace rig {
namespace {

using namespace asio::experimental::awaitable_operators;

constexpr int looks_of_nobody = 3;  // A simulated bench that placed it wrongly three times will not learn.

json json_of(const Placement& place) {
  json result = {{"target", place.target}};
  if (place.shift_mm) result["shift_mm"] = *place.shift_mm;
  if (place.reflectance) result["reflectance"] = *place.reflectance;
  if (place.temperature_c) result["temperature_c"] = *place.temperature_c;
  return result;
}

std::optional<double> maybe(const json& object, const char* key) {
  if (!object.contains(key) || !object[key].is_number()) return std::nullopt;
  return object[key].get<double>();
}

}  // namespace

awaitable<Answer> Runner::Impl::ask(Prompt prompt) {
  const auto before = state.phase;
  for (int look = 1;; ++look) {
    state.phase = RunState::Phase::prompt;
    state.prompt = prompt;
    state.activity = "prompt: " + prompt.title;
    note("info", "asks: " + prompt.title);
    auto asking = ask_once(prompt);
    Answer answer = co_await std::move(asking);
    state.prompt.reset();
    state.phase = before;
    stop_if_aborted();
    if (answer.kind == Answer::Kind::skipped && prompt.skippable) {
      note("info", "skipped: " + prompt.title);
      co_return answer;
    }
    if (answer.kind == Answer::Kind::repeat && repeat_previous_turn()) co_return answer;
    if (answer.kind != Answer::Kind::confirmed) continue;
    prompt.check = wrong_answer(prompt, answer);
    if (prompt.check.empty()) {
      auto applying = apply(prompt);
      co_await std::move(applying);
      if (prompt.until) {
        auto looking = look_at(*prompt.until);
        const Look look_now = co_await std::move(looking);
        if (!look_now.good) prompt.check = look_now.text;
      }
    }
    if (prompt.check.empty()) {
      note("info", "done: " + prompt.title);
      co_return answer;
    }
    note("warning", prompt.title + ": " + prompt.check);
    if (parts.operator_.unattended() && look >= looks_of_nobody)
      throw MeasurementError("'" + prompt.title + "' is not as asked: " + prompt.check +
                             " Nobody is there to mend it. The stage stands; go on with --resume.");
  }
}

awaitable<Answer> Runner::Impl::ask_once(Prompt prompt) {
  answered.reset();
  answer_gate.close();
  auto asking = ask_operator(prompt);
  auto elsewhere = answer_gate.wait();
  auto late = prompt.timeout_s > 0 ? pause_for(prompt.timeout_s) : never();
  auto watching = watch_bench(prompt.until);
  co_await (std::move(asking) || std::move(elsewhere) || std::move(late) || std::move(watching));
  auto resting = end_watch();
  co_await std::move(resting);
  stop_if_aborted();
  if (operator_failed) std::rethrow_exception(std::exchange(operator_failed, nullptr));
  if (!answered)
    throw RunStopped("Nobody answered '" + prompt.title + "' in " + duration_with_unit(prompt.timeout_s) +
                     ". The stage stands, and what was captured is in " + session.path() +
                     ". Go on with --resume.");
  co_return *answered;
}

awaitable<void> Runner::Impl::ask_operator(Prompt prompt) {
  try {
    auto asking = parts.operator_.ask(prompt);
    const Answer given = co_await std::move(asking);
    if (!answered) answered = given;
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
  if (!number) return "the answer must be " + wanted + ".";
  if ((question.min && *number < *question.min) || (question.max && *number > *question.max))
    return to_text(*number) + " is not believed; the answer must be " + wanted + ".";
  return "";
}

awaitable<void> Runner::Impl::apply(const Prompt& prompt) {
  if (!prompt.place) co_return;
  const Placement place = *prompt.place;
  Placement& known = scene[place.target];
  known.target = place.target;
  if (place.shift_mm) known.shift_mm = place.shift_mm;
  if (place.reflectance) known.reflectance = place.reflectance;
  if (place.temperature_c) scene[""].temperature_c = place.temperature_c;
  json all = json::array();
  for (const auto& [target, each] : scene) all.push_back(json_of(each));
  record("scene", all);
  if (!place.since_power_on_s) co_return;
  power_on_us = now_us() - static_cast<std::int64_t>(1e6 * *place.since_power_on_s);
  record("power_on_us", *power_on_us);
  streaming = false;
  power_cycle_told = true;
  note("info", "the lidar was switched off and on: the rig connects to it anew");
  auto connecting = connect_again(nullptr);
  co_await std::move(connecting);
}

void Runner::Impl::restore_scene() {
  if (const json since = progress_of("power_on_us"); since.is_number_integer())
    power_on_us = since.get<std::int64_t>();
  const json all = progress_of("scene");
  if (!all.is_array()) return;
  for (const json& each : all) {
    Placement place;
    place.target = each.value("target", "");
    place.shift_mm = maybe(each, "shift_mm");
    place.reflectance = maybe(each, "reflectance");
    place.temperature_c = maybe(each, "temperature_c");
    scene[place.target] = place;
  }
}

awaitable<void> Runner::Impl::place_again() {
  if (!parts.operator_.unattended()) co_return;
  for (const auto& [target, place] : scene) {
    Prompt prompt;
    prompt.title = "put back " + (target.empty() ? "the temperature" : target);
    prompt.place = place;
    auto asking = parts.operator_.ask(prompt);
    co_await std::move(asking);
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
