// SPDX-License-Identifier: MIT
#include "rig/procedure/procedure_plan.hpp"

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

namespace rig {
namespace {

constexpr std::size_t most_steps = 200'000;

class Unroller {
 public:
  Unroller(const Procedure& procedure, const fit::Bench& bench) {
    plan_.bench = &bench;
    plan_.limits = stage_limits(bench);
    plan_.rules = procedure.stage;
    plan_.variables = procedure.variables;
  }

  std::vector<PlannedStep> run(const std::vector<Step>& steps) {
    walk(steps, {}, "", {});
    return std::move(planned_);
  }

 private:
  void walk(const std::vector<Step>& steps, const Variables& loop, const std::string& turn,
            const std::vector<std::string>& turns) {
    for (const Step& step : steps) {
      if (!step.kind->has_steps()) {
        add(step, loop, turn, turns);
        continue;
      }
      Variables all = plan_.variables;
      for (const auto& [name, value] : loop) all[name] = value;
      std::map<std::string, int> times;
      for (const Variables& own : iterations(step.options, all)) {
        Variables inner = loop;
        std::string label = turn;
        for (const auto& [name, value] : own) {
          inner[name] = value;
          label += "[" + name + "=" + to_text(value) + "]";
        }
        // What is done is known by its label: another turn of the same values needs one of its own.
        if (const int time = ++times[label]; time > 1) label += "[time " + std::to_string(time) + "]";
        auto path = turns;
        path.push_back(step.ordinal + label);
        walk(step.steps, inner, label, path);
      }
    }
  }

  void add(const Step& step, const Variables& loop, const std::string& turn,
           const std::vector<std::string>& turns) {
    if (planned_.size() >= most_steps)
      throw ProcedureError(step.position, "the procedure has more than 200,000 steps; shorten its loops.");
    PlannedStep planned;
    planned.step = &step;
    planned.key = step.ordinal + turn;
    planned.loop_variables = loop;
    planned.turns = turns;
    Plan plan = plan_;
    plan.seconds = plan.travel_deg = 0;
    plan.captures = plan.scans = 0;
    plan.at_least = false;
    plan.says.clear();
    Variables visible = plan_.variables;
    for (const auto& [name, value] : loop) visible[name] = value;
    plan.variables = plan_.variables;
    for (const auto& name : step.kind->defines(step.options)) plan.variables[name] = Unknown{};
    step.kind->plan(Arguments(step.options, step.kind->options(), visible), plan);
    planned.says = plan.says;
    planned.seconds = plan.seconds;
    planned.travel_deg = plan.travel_deg;
    planned.captures = plan.captures;
    planned.scans = plan.scans;
    planned.at_least = plan.at_least;
    planned_.push_back(std::move(planned));
    plan_ = std::move(plan);
  }

  Plan plan_;
  std::vector<PlannedStep> planned_;
};

std::string limit_text(const Limit& limit) {
  std::string text = "  " + limit.name + " (" + limit.kind + "." + limit.value + "):";
  if (limit.min) text += " at least " + to_text(*limit.min);
  if (limit.max) text += std::string(limit.min ? ", " : " ") + "at most " + to_text(*limit.max);
  if (limit.max_expanded) text += " expanded uncertainty at most " + to_text(*limit.max_expanded);
  if (limit.guarded) text += ", guard band as wide as the expanded uncertainty";
  if (limit.guard_band > 0) text += ", guard band " + to_text(limit.guard_band);
  return text + "\n";
}

}  // namespace

StageLimits stage_limits(const fit::Bench& bench) {
  StageLimits limits;
  const auto& stage = bench.document.section("stage");
  const auto range = stage.value("limits_deg", nlohmann::json());
  if (range.is_array() && range.size() == 2 && range[0].is_number() && range[1].is_number()) {
    limits.min_deg = range[0].get<double>();
    limits.max_deg = range[1].get<double>();
  }
  if (stage.contains("speed_deg_s") && stage["speed_deg_s"].is_number() &&
      stage["speed_deg_s"].get<double>() > 0)
    limits.speed_deg_s = stage["speed_deg_s"].get<double>();
  return limits;
}

std::vector<PlannedStep> unroll(const Procedure& procedure, const fit::Bench& bench) {
  return Unroller(procedure, bench).run(procedure.steps);
}

namespace {

long whole_seconds(double seconds) { return std::lround(std::max(0.0, seconds)); }

constexpr long hour_s = 3600;

}  // namespace

std::string session_time_text(double seconds) {
  const long whole = whole_seconds(seconds);
  char text[40];
  std::snprintf(text, sizeof text, "%ld:%02ld:%02ld", whole / hour_s, whole / 60 % 60, whole % 60);
  return text;
}

std::string grouped(long number) {
  std::string digits = std::to_string(number);
  for (auto at = static_cast<std::ptrdiff_t>(digits.size()) - 3; at > (number < 0 ? 1 : 0); at -= 3)
    digits.insert(static_cast<std::size_t>(at), ",");
  return digits;
}

std::string dry_run_text(const Procedure& procedure, const fit::Bench& bench,
                         const std::vector<PlannedStep>& plan) {
  std::string text = procedure.title + " (" + procedure.file + ")\n";
  double seconds = 0, travel_deg = 0;
  long captures = 0, scans = 0;
  bool at_least = false;
  for (std::size_t i = 0; i < plan.size(); ++i) {
    const PlannedStep& step = plan[i];
    seconds += step.seconds, travel_deg += step.travel_deg, captures += step.captures, scans += step.scans;
    at_least = at_least || step.at_least;
    char line[64];
    std::snprintf(line, sizeof line, "%4zu  %-12s ", i + 1, duration_text(step.seconds).c_str());
    text +=
        line + step.says + "   [" + step.key + ", line " + std::to_string(step.step->position.line) + "]\n";
  }
  char travel[40];
  std::snprintf(travel, sizeof travel, "%.1f", travel_deg);
  text += "\n" + std::to_string(plan.size()) + " steps, " + grouped(captures) + " captures, " +
          grouped(scans) + " scans, travel " + travel + " deg, " + (at_least ? "at least " : "about ") +
          duration_text(seconds) + " at " + to_text(bench.lidar.scan_hz) + " scans/s.\n";
  if (at_least) text += "The run may take longer: some steps depend on values that only it will know.\n";
  const StageLimits limits = stage_limits(bench);
  text += limits.has_min() ? "Soft limits of the stage: " + to_text(limits.min_deg) + " to " +
                                 to_text(limits.max_deg) + " deg; every known target lies within.\n"
                           : "The bench file gives no soft limits (stage.limits_deg).\n";
  if (!procedure.limits.empty()) text += "Acceptance limits:\n";
  for (const Limit& limit : procedure.limits) text += limit_text(limit);
  return text;
}

}  // namespace rig
