// SPDX-License-Identifier: MIT
#include <nlohmann/json.hpp>

#include "rig/runner/runner.hpp"

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

json prompt_json(const Prompt& prompt) {
  json result = {
      {"title", prompt.title}, {"text", prompt.text}, {"can_skip", prompt.skippable}, {"can_repeat", true}};
  if (!prompt.picture.empty()) result["picture"] = prompt.picture;
  if (!prompt.check.empty()) result["check"] = {{"text", prompt.check}, {"good", false}};
  if (prompt.check.empty() && !prompt.seen.empty()) result["check"] = {{"text", prompt.seen}, {"good", true}};
  if (prompt.question) {
    result["ask"] = {{"name", prompt.question->name}, {"unit", prompt.question->unit}};
    if (prompt.question->min) result["ask"]["min"] = *prompt.question->min;
    if (prompt.question->max) result["ask"]["max"] = *prompt.question->max;
  }
  return result;
}

json results_json(const std::string& checks_text) {
  json results = json::array();
  for (const json& check : json::parse(checks_text))
    results.push_back({{"name", check.value("name", "")},
                       {"text", check.value("text", "")},
                       {"verdict", check.value("verdict", "")}});
  return results;
}

/// A window around the running step: a procedure may have thousands.
json steps_json(const RunState& state) {
  constexpr std::size_t before = 10, after = 40;
  const std::size_t first = state.step > before ? state.step - before : 0;
  json steps = json::array();
  for (std::size_t i = first; i < std::min(state.steps.size(), state.step + after); ++i)
    steps.push_back({{"text", state.steps[i].first}, {"state", word(state.steps[i].second)}});
  return steps;
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

json to_json(const RunState& state, const fit::Bench& bench) {
  json document = {{"schema", "live/1"},
                   {"phase", phase_word(state.phase)},
                   {"procedure", state.procedure},
                   {"session", state.session},
                   {"steps", steps_json(state)},
                   {"stage_deg", state.stage_deg},
                   {"pausing", state.pausing},
                   {"results", results_json(state.checks_text)},
                   {"progress",
                    {{"done", state.done},
                     {"total", state.total},
                     {"unit", state.unit},
                     {"left_s", state.left_s},
                     {"overall", state.overall}}}};
  if (state.step < state.steps.size())
    document["step"] = {
        {"n", state.step + 1}, {"of", state.steps.size()}, {"text", state.steps[state.step].first}};
  if (state.prompt) document["prompt"] = prompt_json(*state.prompt);
  if (state.scan_seen) {
    const double step_deg = bench.lidar.step_rad * fit::deg_per_rad;
    document["scan"] = {{"first_deg", bench.lidar.beam_angle(state.scan.first_step) * fit::deg_per_rad},
                        {"step_deg", step_deg * state.scan.cluster},
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
    document["messages"].push_back({{"time", duration_text(static_cast<double>(message.time_us) / 1e6)},
                                    {"level", message.level},
                                    {"text", message.text}});
  return document;
}

}  // namespace rig
