// SPDX-License-Identifier: MIT
#include "rig/investigate/cost.hpp"

#include <algorithm>
#include <map>
#include <optional>
#include <string>

namespace rig::investigate {
namespace {

bool is_prompt(const PlannedStep& step) { return step.step->kind->asks_a_person(); }

/// What a prompt asks for, of what costs time.
struct Asked {
  std::string target;
  std::optional<double> place_mm, reflectance, temperature_c, since_power_on_s;
};

Asked asked_by(const PlannedStep& planned, const Variables& variables) {
  Variables known = variables;
  for (const auto& [name, value] : planned.loop_variables) known[name] = value;
  const Arguments arguments(planned.step->options, planned.step->kind->options(), known);
  if (!arguments.has("place")) return {};
  const Arguments place = arguments.map("place");
  Asked asked;
  asked.target = place.text_or("target", "");
  asked.place_mm = place.maybe_number(place.has("at_mm") ? "at_mm" : "shift_mm");
  asked.reflectance = place.maybe_number("reflectance");
  asked.temperature_c = place.maybe_number("temperature_c");
  asked.since_power_on_s = place.maybe_number("since_power_on_s");
  return asked;
}

}  // namespace

Cost cost_of(const std::vector<PlannedStep>& plan, const Variables& variables) {
  Cost cost;
  std::map<std::string, Asked> standing;
  for (const PlannedStep& step : plan) {
    if (!is_prompt(step)) {
      cost.stage_and_scans += step.seconds / 60;
      continue;
    }
    const Asked asked = asked_by(step, variables);
    Asked& before = standing[asked.target];
    double minutes = 0;
    if (asked.place_mm && asked.place_mm != before.place_mm) minutes += move_min;
    if (asked.reflectance && asked.reflectance != before.reflectance) minutes += cover_min;
    if (asked.temperature_c && asked.temperature_c != standing[""].temperature_c) minutes += temperature_min;
    // Switched off until cold, and on for that long when it is confirmed.
    if (asked.since_power_on_s) minutes += cooling_min + *asked.since_power_on_s / 60;
    cost.hand += minutes > 0 ? minutes : other_prompt_min;
    if (asked.place_mm) before.place_mm = asked.place_mm;
    if (asked.reflectance) before.reflectance = asked.reflectance;
    if (asked.temperature_c) standing[""].temperature_c = asked.temperature_c;
  }
  return cost;
}

bool needs_operator(const std::vector<PlannedStep>& plan) { return std::ranges::any_of(plan, is_prompt); }

}  // namespace rig::investigate
