// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rig/runner/runner.hpp"
#include "rig/session/step_in_words.hpp"
#include "rig/session/targets_in_view.hpp"

namespace rig {
namespace {

using nlohmann::json;

const char* word(RunState::StepState state) {
  switch (state) {
    case RunState::StepState::not_started:
      return "not started";
    case RunState::StepState::running:
      return "running";
    case RunState::StepState::recorded:
      return "recorded";
  }
  return "";
}

json results_json(const std::string& checks_text) {
  json results = json::array();
  for (const json& check : json::parse(checks_text))
    results.push_back({{"name", check.value("name", "")},
                       {"text", check.value("text", "")},
                       {"verdict", check.value("verdict", "")}});
  return results;
}

std::string number_of_step(const RunState& state, std::size_t step) {
  return rig::number_of_step(step < state.step_keys.size() ? state.step_keys[step]
                                                           : std::to_string(step + 1));
}

/// A window around the running step: a procedure may have thousands.
json steps_json(const RunState& state) {
  constexpr std::size_t before = 10, after = 40;
  const std::size_t first = state.step > before ? state.step - before : 0;
  json steps = json::array();
  for (std::size_t i = first; i < std::min(state.steps.size(), state.step + after); ++i)
    steps.push_back({{"number", number_of_step(state, i)},
                     {"text", state.steps[i].first},
                     {"state", word(state.steps[i].second)}});
  return steps;
}

/// PASS, FAIL or nothing where no limit was checked.
std::string verdict_of(const json& checks) {
  if (checks.empty()) return "";
  const bool pass =
      std::ranges::all_of(checks, [](const json& check) { return check.value("verdict", "") == "pass"; });
  return pass ? "PASS" : "FAIL";
}

/// How the run ended: what a person reads from across the room, and what to do next.
json end_json(const RunState& state) {
  const bool done = state.phase == RunState::Phase::done;
  json end = {{"verdict", done ? verdict_of(json::parse(state.checks_text)) : ""},
              {"text", state.ended},
              {"report", std::filesystem::path(state.report).filename().string()}};
  if (!done) end["go_on"] = "rig resume " + state.session_path;
  return end;
}

}  // namespace

const char* phase_word(RunState::Phase phase) {
  switch (phase) {
    case RunState::Phase::starting:
      return "starting";
    case RunState::Phase::running:
      return "running";
    case RunState::Phase::prompt:
      return "prompt";
    case RunState::Phase::paused:
      return "paused";
    case RunState::Phase::done:
      return "done";
    case RunState::Phase::failed:
      return "failed";
    case RunState::Phase::aborted:
      return "aborted";
  }
  return "";
}

json to_json(const Placement& place) {
  json what = json::object();
  if (!place.target.empty()) what["target"] = place.target;
  if (place.shift_mm) what["shift_mm"] = *place.shift_mm;
  if (place.reflectance) what["reflectance"] = *place.reflectance;
  if (place.temperature_c) what["temperature_c"] = *place.temperature_c;
  if (place.since_power_on_s) what["since_power_on_s"] = *place.since_power_on_s;
  return what;
}

json to_json(const Prompt& prompt) {
  json result = {{"number", prompt.number},
                 {"title", prompt.title},
                 {"text", prompt.text},
                 {"can_skip", prompt.skippable},
                 {"can_repeat", prompt.repeatable}};
  if (!prompt.picture.empty()) result["picture"] = prompt.picture;
  if (!prompt.refusal.empty()) result["refusal"] = prompt.refusal;
  if (prompt.to_go_mm) result["to_go_mm"] = std::round(*prompt.to_go_mm);
  if (!prompt.check.empty()) result["check"] = {{"text", prompt.check}, {"good", false}};
  if (prompt.check.empty() && !prompt.seen.empty()) result["check"] = {{"text", prompt.seen}, {"good", true}};
  if (prompt.question) {
    result["ask"] = {{"name", prompt.question->name}, {"unit", prompt.question->unit}};
    if (prompt.question->min) result["ask"]["min"] = *prompt.question->min;
    if (prompt.question->max) result["ask"]["max"] = *prompt.question->max;
  }
  if (prompt.place) result["place"] = to_json(*prompt.place);
  return result;
}

json to_json(const RunState& state, const fit::Bench& bench) {
  json document = {
      {"schema", "live/1"},
      {"phase", phase_word(state.phase)},
      {"procedure", state.procedure},
      {"session", state.session},
      {"steps", steps_json(state)},
      {"stage_deg", state.stage_deg},
      {"targets", targets_in_view(bench, state.stage_deg)},
      {"pausing", state.pausing},
      {"results", results_json(state.checks_text)},
      {"progress",
       {{"done", state.done}, {"total", state.total}, {"unit", state.unit}, {"overall", state.overall}}}};
  // Nobody knows how long a person takes.
  const bool waits = state.phase == RunState::Phase::prompt || state.phase == RunState::Phase::paused;
  if (!waits) document["progress"]["left_s"] = state.left_s;
  if (state.step < state.steps.size())
    document["step"] = {{"n", state.step + 1},
                        {"of", state.steps.size()},
                        {"number", number_of_step(state, state.step)},
                        {"text", state.steps[state.step].first}};
  if (state.prompt) document["prompt"] = to_json(*state.prompt);
  if (state.prompt && state.prompt->until && state.prompt->until->target)
    document["prompt"]["ghost"] = target_in_view(*state.prompt->until->target, bench, state.stage_deg);
  if (state.phase >= RunState::Phase::done) document["end"] = end_json(state);
  if (state.scan_seen) {
    fit::CaptureInfo scanned;
    scanned.first_step = state.scan.first_step;
    scanned.last_step = state.scan.last_step;
    scanned.cluster = state.scan.cluster;
    const std::optional<fit::ScanGeometry> none;
    const fit::BeamAngles angles(bench.lidar, scanned, none);
    document["scan"] = {{"first_deg", angles.first_rad() * fit::deg_per_rad},
                        {"step_deg", angles.step_rad() * fit::deg_per_rad},
                        {"range_mm", state.scan.range_mm},
                        {"intensity", state.scan.intensity}};
  }
  if (!state.beam_mm.empty()) document["beam"] = {{"step", state.beam_step}, {"range_mm", state.beam_mm}};
  document["health"] = {
      {{"name", "scans lost"}, {"text", std::to_string(state.scans_lost)}, {"good", state.scans_lost == 0}},
      {{"name", "answers refused"},
       {"text", std::to_string(state.scans_rejected)},
       {"good", state.scans_rejected == 0}},
      {{"name", "reconnections"},
       {"text", std::to_string(state.reconnects)},
       {"good", state.reconnects == 0}}};
  document["messages"] = json::array();
  document["messages_total"] = state.messages_total;
  for (const auto& message : state.messages)
    document["messages"].push_back({{"time", session_time_text(static_cast<double>(message.time_us) / 1e6)},
                                    {"level", message.level},
                                    {"text", message.text}});
  return document;
}

}  // namespace rig
