// SPDX-License-Identifier: MIT
#include "rig/live/session_state.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/session/step_in_words.hpp"
#include "rig/session/targets_in_view.hpp"

namespace rig {
namespace {

using json = nlohmann::json;
constexpr std::size_t longest_history = 500;

std::string clock_text(std::int64_t host_us) {
  const auto s = host_us / 1'000'000;
  char text[32];
  std::snprintf(text, sizeof text, "%d:%02d:%02d", static_cast<int>(s / 3600), static_cast<int>(s / 60 % 60),
                static_cast<int>(s % 60));
  return text;
}

/// The last scan of the newest capture and the recent history of its middle beam.
void add_newest_capture(json& state, const fit::Recording& recording) {
  const auto& captures = recording.captures();
  if (captures.empty()) return;
  const fit::CaptureInfo& capture = captures.back();
  const fit::LidarGeometry& lidar = recording.bench().lidar;
  std::vector<std::uint16_t> ranges, history;
  double first_rad = 0, step_rad = lidar.step_rad;
  recording.for_each_scan(captures.size() - 1, [&](const fit::ScanView& scan) {
    ranges.assign(scan.range_mm.begin(), scan.range_mm.end());
    const fit::BeamAngles angles(lidar, capture, scan.geometry);
    first_rad = angles.first_rad();
    step_rad = angles.step_rad();
    if (!ranges.empty()) history.push_back(ranges[ranges.size() / 2]);
  });
  if (history.size() > longest_history) history.erase(history.begin(), history.end() - longest_history);
  state["scan"] = {{"first_deg", first_rad * fit::deg_per_rad},
                   {"step_deg", step_rad * fit::deg_per_rad},
                   {"range_mm", ranges}};
  state["beam"] = {{"step", (capture.first_step + capture.last_step) / 2}, {"range_mm", history}};
  const double stage_deg = capture.stage_readback_rad.value_or(capture.stage_rad) * fit::deg_per_rad;
  state["stage_deg"] = stage_deg;
  state["targets"] = targets_in_view(recording.bench(), stage_deg);
}

void add_results(json& state, const SessionStore& session) {
  for (const SessionStore::Result& result : session.latest_results()) {
    const json document = json::parse(result.json, nullptr, false);
    for (const json& value : list_of(document, "values")) {
      const double number = number_of(value, "value");
      if (std::isnan(number)) continue;
      state["results"].push_back(
          {{"name", text_of(value, "label", text_of(value, "name", result.kind))},
           {"text", fit::format_measurement(number, expanded_of(value, 0), text_of(value, "unit", ""))}});
    }
    for (const json& check :
         list_of(document, "checks"))  // The limits; those of earlier versions have no text.
      if (check.is_object())
        state["results"].push_back(
            {{"name", text_of(check, "name", "limit")},
             {"text", text_of(check, "text",
                              fit::format_measurement(number_of(check, "value"), number_of(check, "U", 0),
                                                      text_of(check, "unit", "")))},
             {"verdict", text_of(check, "verdict", "")}});
  }
}

/// The steps of the captures: all that the session of an import knows.
json captured_steps(const fit::Recording& recording) {
  json steps = json::array();
  for (const fit::CaptureInfo& capture : recording.captures())
    if (steps.empty() || steps.back().at("text") != capture.step)
      steps.push_back({{"text", capture.step}, {"state", "recorded"}});
  return steps;
}

/// The steps of the procedure, some before and some after the first that is not recorded; those of the
/// captures where no procedure ran.
void add_steps(json& state, const SessionStore& session, const fit::Recording& recording) {
  constexpr std::size_t before = 10, after = 40;
  const std::size_t captures = recording.captures().size();
  const std::string captured = std::to_string(captures) + (captures == 1 ? " capture" : " captures");
  const json plan = json::parse(session.get("steps").value_or("null"), nullptr, false);
  state["step"] = {{"n", captures}, {"of", captures}, {"text", captured + " recorded"}};
  state["steps"] = captured_steps(recording);
  if (!plan.is_array() || plan.empty()) return;
  const auto progress = session.progress();
  const auto is_recorded = [&](const json& step) { return progress.count(text_of(step, "key", "")) > 0; };
  const auto recorded = static_cast<std::size_t>(std::ranges::count_if(plan, is_recorded));
  const auto next = static_cast<std::size_t>(std::ranges::find_if_not(plan, is_recorded) - plan.begin());
  state["step"] = {{"n", recorded}, {"of", plan.size()}, {"text", captured + " recorded"}};
  state["steps"] = json::array();
  for (std::size_t i = next > before ? next - before : 0; i < std::min(plan.size(), next + after); ++i)
    state["steps"].push_back({{"number", number_of_step(text_of(plan[i], "key", ""))},
                              {"text", text_of(plan[i], "text", "")},
                              {"state", is_recorded(plan[i]) ? "recorded" : "not started"}});
}

}  // namespace

json state_of(const SessionStore& session) {
  json state = {
      {"schema", "live/1"},
      {"phase", "watching"},
      {"procedure", session.get("procedure_name").value_or(session.get("kind").value_or("recording"))},
      {"session", std::filesystem::path(session.path()).filename().string()},
      {"messages", json::array()},
      {"results", json::array()}};
  const auto recording = session.recording();
  add_steps(state, session, *recording);
  add_newest_capture(state, *recording);
  for (const SessionStore::Event& event : session.events())
    state["messages"].push_back(
        {{"time", clock_text(event.host_us)}, {"level", event.level}, {"text", event.text}});
  add_results(state, session);
  return state;
}

}  // namespace rig
