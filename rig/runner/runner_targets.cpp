// SPDX-License-Identifier: MIT
// What the runner itself sees of the bench's targets.
#include <algorithm>
#include <cmath>

#include "rig/runner/bench_doubts.hpp"
#include "rig/runner/runner_impl.hpp"

namespace rig {
namespace {

/// The text of a step's option with the variables of its turn; empty if it has none.
std::string option_text(const Node& options, const std::string& name, const Variables& variables) {
  const Node* node = options.find(name);
  if (!node || node->kind != Node::Kind::scalar) return "";
  try {
    return to_text(evaluate_text(node->scalar, variables));
  } catch (const ExpressionError&) {  // It uses what only the run will know.
    return "";
  }
}

/// The targets that a procedure measures without a prompt having placed them.
std::set<std::string> taken_for_granted(const std::vector<PlannedStep>& plan, const Variables& variables,
                                        const fit::Bench& bench) {
  std::set<std::string> used, placed;
  for (const PlannedStep& step : plan) {
    Variables all = variables;
    for (const auto& [name, value] : step.loop_variables) all[name] = value;
    const StepKind& kind = *step.step->kind;
    if (kind.measures()) {
      const std::string target = option_text(step.step->options, "target", all);
      if (!target.empty()) used.insert(target);
      if (target.empty())
        for (const fit::Target& each : bench.targets) used.insert(each.name);
    } else if (const Node* place = kind.places(step.step->options)) {
      placed.insert(option_text(*place, "target", all));
    }
  }
  std::set<std::string> granted;
  std::ranges::set_difference(used, placed, std::inserter(granted, granted.end()));
  return granted;
}

std::string quoted(const std::string& name) { return "'" + name + "'"; }

}  // namespace

void Runner::Impl::expect(Prompt& prompt) const {
  if (!prompt.until || !prompt.until->of_target || !prompt.place) return;
  const fit::Target* target = known_bench.target(prompt.place->target);
  if (!target) return;
  fit::Target wanted = placed.as_placed(*target);
  if (prompt.place->shift_mm) wanted = shifted(*target, *prompt.place->shift_mm);
  // As stated before it was placed: only what a prompt says can be compared with another surface.
  wanted.reflectance = prompt.place->reflectance;
  prompt.until->target = wanted;
}

bool Runner::Impl::can_see(const fit::Target& target) const {
  if (!referenced) return false;
  const auto ranges = expected_ranges_mm(known_bench, target, position_deg * fit::rad_per_deg);
  return std::ranges::any_of(ranges, [](double range) { return std::isfinite(range); });
}

Runner::Impl::Observation Runner::Impl::judge_target(const Expectation& expected,
                                                     const BeamMedians& seen) const {
  const fit::Target& target = *expected.target;
  std::vector<fit::Target> others;
  const auto granted = taken_for_granted(plan, variables, known_bench);
  for (const fit::Target& each : known_bench.targets)
    if (placed.has_placed(each.name) || granted.contains(each.name)) others.push_back(placed.as_placed(each));
  const TargetDetection found = detect_target(known_bench, target, others, position_deg * fit::rad_per_deg,
                                              seen, expected.tolerance_mm);
  Observation observed;
  const bool silent = found.outcome == TargetDetection::Outcome::undetected && !expected.echo;
  observed.good = found.good() || silent;
  observed.in_view = found.outcome != TargetDetection::Outcome::out_of_view;
  observed.text = quoted(target.name) +
                  (silent         ? " cannot be checked: "
                   : found.good() ? " is in place: "
                                  : " is not in its place: ") +
                  found.words + ".";
  if (!observed.in_view) observed.text = quoted(target.name) + ": " + found.words + ".";
  const bool somewhere = found.outcome == TargetDetection::Outcome::in_place ||
                         found.outcome == TargetDetection::Outcome::misplaced;
  if (somewhere) observed.to_go_mm = found.to_go_mm;
  if (somewhere && std::isfinite(found.intensity)) observed.intensity = found.intensity;
  return observed;
}

std::string Runner::Impl::wrong_surface(const Expectation& expected, const Observation& observed) {
  const fit::Target& target = *expected.target;
  if (!expected.surface || !target.reflectance || !observed.intensity) return "";
  return surfaces.contradiction(target.name, {distance_mm(target), *target.reflectance, *observed.intensity});
}

void Runner::Impl::remember_unchecked() {
  const auto add = [this](const std::string& name) {
    const fit::Target* target = known_bench.target(name);
    if (!target) return;
    Expectation expected;
    expected.of_target = true;
    expected.target = placed.as_placed(*target);
    unchecked[name] = expected;
  };
  for (const auto& [name, place] : placed.placements()) add(name);
  for (const std::string& name : taken_for_granted(plan, variables, known_bench)) add(name);
}

awaitable<void> Runner::Impl::check_targets() {
  std::vector<Expectation> visible;
  for (const auto& [name, expected] : unchecked)
    if (can_see(*expected.target)) visible.push_back(expected);
  for (const Expectation& expected : visible) {
    const Observation observed = co_await observe(expected);
    unchecked.erase(expected.target->name);
    if (observed.good) continue;
    note("warning", observed.text);
    if (parts.doubts_bench) continue;
    if (parts.operator_.unattended())
      throw MeasurementError(
          observed.text +
          " Unattended run: cannot be corrected. Put it there, or correct from_mm and to_mm in "
          "the bench file and begin a new session. The stage has stopped; continue with rig resume.");
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

}  // namespace rig
