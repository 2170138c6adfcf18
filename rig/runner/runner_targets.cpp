// SPDX-License-Identifier: MIT
// What the runner itself sees of the bench's targets.
#include <algorithm>
#include <cmath>

#include "rig/runner/bench_doubts.hpp"
#include "rig/runner/runner_impl.hpp"

namespace rig {
namespace {

// Two surfaces whose reflectances differ by so much return different echoes from one distance.
constexpr double very_different = 2, same_echo = 1.03, same_distance = 0.02;

bool measures(const std::string& kind) {
  return kind == "capture" || kind == "sweep" || kind == "turn" || kind == "find-edge";
}

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
    const std::string kind = step.step->kind->name();
    if (measures(kind)) {
      const std::string target = option_text(step.step->options, "target", all);
      if (!target.empty()) used.insert(target);
      if (target.empty())
        for (const fit::Target& each : bench.targets) used.insert(each.name);
    } else if (const Node* place = kind == "prompt" ? step.step->options.find("place") : nullptr) {
      placed.insert(option_text(*place, "target", all));
    }
  }
  std::set<std::string> granted;
  std::ranges::set_difference(used, placed, std::inserter(granted, granted.end()));
  return granted;
}

std::string quoted(const std::string& name) { return "'" + name + "'"; }

}  // namespace

fit::Target Runner::Impl::as_placed(const fit::Target& target) const {
  const auto known = scene.find(target.name);
  if (known == scene.end()) return target;
  fit::Target placed = shifted(target, known->second.shift_mm.value_or(0));
  if (known->second.reflectance) placed.reflectance = known->second.reflectance;
  return placed;
}

void Runner::Impl::expect(Prompt& prompt) const {
  if (!prompt.until || !prompt.until->of_target || !prompt.place) return;
  const fit::Target* target = known_bench.target(prompt.place->target);
  if (!target) return;
  fit::Target placed = as_placed(*target);
  if (prompt.place->shift_mm) placed = shifted(*target, *prompt.place->shift_mm);
  // As stated before it was placed: only what a prompt says can be compared with another surface.
  placed.reflectance = prompt.place->reflectance;
  prompt.until->target = placed;
}

bool Runner::Impl::can_see(const fit::Target& target) const {
  if (!referenced) return false;
  const auto ranges = expected_ranges_mm(known_bench, target, position_deg * fit::rad_per_deg);
  return std::ranges::any_of(ranges, [](double range) { return std::isfinite(range); });
}

Runner::Impl::Look Runner::Impl::judge_target(const Sight& sight, const SeenBeams& seen) const {
  const fit::Target& target = *sight.target;
  std::vector<fit::Target> others;
  const auto granted = taken_for_granted(plan, variables, known_bench);
  for (const fit::Target& each : known_bench.targets)
    if (scene.contains(each.name) || granted.contains(each.name)) others.push_back(as_placed(each));
  const TargetSight found = look_for(known_bench, target, others, position_deg * fit::rad_per_deg, seen,
                                     sight.tolerance_mm);
  Look look;
  const bool silent = found.place == TargetSight::Place::unseen && !sight.echo;
  look.good = found.good() || silent;
  look.in_view = found.place != TargetSight::Place::out_of_view;
  look.text = quoted(target.name) +
              (silent ? " cannot be checked: " : found.good() ? " is in place: " : " is not in its place: ") +
              found.words + ".";
  if (!look.in_view) look.text = quoted(target.name) + ": " + found.words + ".";
  const bool somewhere =
      found.place == TargetSight::Place::as_asked || found.place == TargetSight::Place::elsewhere;
  if (somewhere) look.to_go_mm = found.to_go_mm;
  if (somewhere && std::isfinite(found.intensity)) look.intensity = found.intensity;
  return look;
}

std::string Runner::Impl::wrong_surface(const Sight& sight, const Look& look) {
  const fit::Target& target = *sight.target;
  if (!sight.surface || !target.reflectance || !look.intensity) return "";
  const Surface here{distance_mm(target), *target.reflectance, *look.intensity};
  auto& known = surfaces[target.name];
  for (const Surface& other : known) {
    if (std::abs(other.distance_mm - here.distance_mm) > same_distance * here.distance_mm) continue;
    const bool lighter = here.reflectance > other.reflectance;
    const double factor = lighter ? here.reflectance / other.reflectance : other.reflectance / here.reflectance;
    const double stronger = lighter ? here.intensity / other.intensity : other.intensity / here.intensity;
    if (factor >= very_different && stronger < same_echo)
      return quoted(target.name) + " does not look as asked for: its echo is " + rounded_text(here.intensity, 0) +
             ", that of a surface of reflectance " + to_text(other.reflectance) + " was " +
             rounded_text(other.intensity, 0) + ", and " + to_text(here.reflectance) + " is asked for.";
  }
  known.push_back(here);
  return "";
}

void Runner::Impl::remember_unchecked() {
  const auto look_for_it = [this](const std::string& name) {
    const fit::Target* target = known_bench.target(name);
    if (!target) return;
    Sight sight;
    sight.of_target = true;
    sight.target = as_placed(*target);
    unchecked[name] = sight;
  };
  for (const auto& [name, place] : scene) look_for_it(name);
  for (const std::string& name : taken_for_granted(plan, variables, known_bench)) look_for_it(name);
}

awaitable<void> Runner::Impl::check_targets() {
  std::vector<Sight> visible;
  for (const auto& [name, sight] : unchecked)
    if (can_see(*sight.target)) visible.push_back(sight);
  for (const Sight& sight : visible) {
    auto looking = look_at(sight);
    const Look look = co_await std::move(looking);
    unchecked.erase(sight.target->name);
    if (look.good) continue;
    note("warning", look.text);
    if (parts.doubts_bench) continue;
    if (parts.operator_.unattended())
      throw MeasurementError(look.text +
                             " Unattended run: cannot be corrected. Put it there, or correct from_mm and to_mm in "
                             "the bench file and begin a new session. The stage stands; go on with rig resume.");
    Prompt prompt;
    prompt.title = "Put '" + sight.target->name + "' where it belongs";
    prompt.text = "Its distance from the stage's axis is to be " + rounded_text(distance_mm(*sight.target), 1) +
                  " mm. If it stands as it should, stop the run and correct from_mm and to_mm in the bench file.";
    prompt.check = look.text;
    prompt.until = sight;
    prompt.skippable = prompt.repeatable = false;
    auto asking = ask(prompt);
    co_await std::move(asking);
  }
}

awaitable<void> Runner::Impl::ask_about_bench() {
  if (session.get("bench_confirmed")) co_return;
  const std::vector<std::string> doubts = doubts_about(known_bench);
  if (doubts.empty()) co_return;
  std::string text;
  for (const std::string& doubt : doubts) text += (text.empty() ? "" : " ") + doubt;
  if (parts.operator_.unattended())
    throw UsageError("The bench file has values out of all proportion. " + text +
                     " Nothing was moved. Correct the bench file, or stay and confirm them (without --yes).");
  Prompt prompt;
  prompt.title = "The bench file has values out of all proportion. Are they right?";
  prompt.text = text + " Nothing has moved yet. Confirm them, or stop and correct the bench file.";
  prompt.skippable = prompt.repeatable = false;
  auto asking = ask(prompt);
  co_await std::move(asking);
  session.set("bench_confirmed", text);
}

}  // namespace rig
