// SPDX-License-Identifier: MIT
#include "rig/procedure/step.hpp"

#include <algorithm>
#include <cmath>

namespace rig {

namespace steps {
std::vector<std::unique_ptr<StepKind>> all();
}

namespace {

constexpr double move_overhead_s = 0.3;  // acceleration and the wait for "idle"
constexpr double capture_overhead_s = 0.15;
constexpr std::size_t most_turns = 100'000;

std::vector<Value> range_of(const Node& node, const Variables& variables) {
  static const std::vector<Option> options = {
      {.name = "from", .about = "first value", .required = true},
      {.name = "to", .about = "last value", .required = true},
      {.name = "step", .about = "difference between values", .required = true}};
  for (const auto& [key, value] : node.members)
    if (std::ranges::find(options, key.scalar, &Option::name) == options.end())
      throw ProcedureError(key.position, "a range has no '" + key.scalar + "'; it takes from, to, step.");
  const Arguments arguments(node, options, variables);
  const double from = arguments.number("from"), to = arguments.number("to"), step = arguments.number("step");
  if (std::isnan(from) || std::isnan(to) || std::isnan(step))
    throw ProcedureError(node.position,
                         "a range must be known before the run; answers and found edges cannot make one.");
  const double count = std::floor((to - from) / step + 1e-9);
  if (step == 0 || count < 0)
    throw ProcedureError(node.position, "the range from " + to_text(from) + " to " + to_text(to) +
                                            " in steps of " + to_text(step) +
                                            " is empty; correct the step's sign or size.");
  if (count >= static_cast<double>(most_turns))
    throw ProcedureError(node.position, "the range has more than 100,000 values; make the step larger.");
  std::vector<Value> values;
  // Counted, not added up: 36,000 additions of 0.01 miss 360.
  for (int i = 0; i <= static_cast<int>(count); ++i)
    values.emplace_back(std::round((from + i * step) * 1e9) / 1e9);
  return values;
}

Value value_of(const Node& item, const Variables& variables) {
  if (item.kind != Node::Kind::scalar)
    throw ProcedureError(item.position, "a for-each value must be a number or a text.");
  const Value value = Arguments(item, {}, variables).value(item);
  if (std::holds_alternative<Unknown>(value))
    throw ProcedureError(item.position, "a for-each value must be known before the run.");
  return value;
}

std::vector<Value> values_of(const Node& node, const Variables& variables) {
  if (node.kind == Node::Kind::map) return range_of(node, variables);
  if (node.kind != Node::Kind::list || node.items.empty())
    throw ProcedureError(node.position,
                         "for-each needs a list [1, 2, 3] or a range {from: 1, to: 3, step: 1}.");
  std::vector<Value> values;
  for (const Node& item : node.items) values.push_back(value_of(item, variables));
  return values;
}

/// Turns that are written out one by one, each a map of the same variables.
std::vector<Variables> listed_turns(const Node& list, const Variables& variables) {
  std::vector<Variables> turns;
  for (const Node& item : list.items) {
    if (item.kind != Node::Kind::map || item.members.empty())
      throw ProcedureError(item.position, "an entry of a for-each is written {name: value, ...}.");
    Variables turn;
    for (const auto& [key, value] : item.members) {
      if (!turns.empty() && !turns.front().contains(key.scalar))
        throw ProcedureError(key.position, "the first entry has no '" + key.scalar +
                                               "'; all entries of a for-each have the same variables.");
      turn[key.scalar] = value_of(value, variables);
    }
    if (!turns.empty())
      for (const auto& [name, value] : turns.front())
        if (!turn.contains(name))
          throw ProcedureError(
              item.position,
              "this entry lacks '" + name +
                  "', which the first has; all entries of a for-each have the same variables.");
    turns.push_back(std::move(turn));
  }
  return turns;
}

}  // namespace

const std::vector<std::unique_ptr<StepKind>>& step_kinds() {
  static const auto kinds = steps::all();
  return kinds;
}

std::vector<std::string> StepKind::defines(const Node&) const { return {}; }

std::vector<Variables> iterations(const Node& options, const Variables& variables) {
  if (options.kind == Node::Kind::list && !options.items.empty()) return listed_turns(options, variables);
  if (options.members.empty())
    throw ProcedureError(options.position,
                         "for-each needs a variable: {name: [values]}, or a list of entries: [{name: value}, "
                         "...].");
  std::vector<Variables> turns = {{}};
  for (const auto& [key, node] : options.members) {
    const auto values = values_of(node, variables);
    if (turns.size() * values.size() > most_turns)
      throw ProcedureError(node.position, "more than 100,000 repetitions; make the lists shorter.");
    std::vector<Variables> longer;
    for (const auto& turn : turns)
      for (const auto& value : values) {
        longer.push_back(turn);
        longer.back()[key.scalar] = value;
      }
    turns = std::move(longer);
  }
  return turns;
}

void Plan::move_to(double target_deg, const FilePosition& written_at, int approach) {
  if (!homed && !rules.unhomed)
    throw ProcedureError(written_at,
                         "the stage would move before it is homed; put a '- home' step before this one, or "
                         "allow it with 'stage: {unhomed: true}'.");
  if (std::isnan(target_deg)) {
    seconds += move_overhead_s + 2 / limits.speed_deg_s;
    stage_deg = target_deg;
    return;
  }
  if (target_deg < limits.min_deg - 1e-9 || target_deg > limits.max_deg + 1e-9)
    throw ProcedureError(written_at, "the stage would go to " + to_text(target_deg) +
                                         " deg, beyond its soft limits " + to_text(limits.min_deg) + " to " +
                                         to_text(limits.max_deg) +
                                         " deg (stage.limits_deg in the bench file).");
  double path = std::abs(target_deg - likely_deg);
  const bool against = approach != 0 && (target_deg - likely_deg) * approach < 0;
  if (against) path += 2 * rules.margin_deg, seconds += move_overhead_s;
  travel_deg += path;
  seconds += path / limits.speed_deg_s + move_overhead_s + rules.settle_s;
  stage_deg = likely_deg = target_deg;
}

void Plan::capture(long samples, double spacing_s) {
  ++captures;
  scans += samples;
  const double period_s = 1 / bench->lidar.scan_hz;
  seconds += static_cast<double>(samples) * std::max(period_s, spacing_s) + capture_overhead_s;
}

void Plan::depends_on(const Arguments& arguments, std::initializer_list<const char*> options) {
  for (const char* option : options) at_least = at_least || std::isnan(arguments.number_or(option, 0));
}

std::vector<Option> capture_options() {
  using Type = Option::Type;
  return {
      {.name = "beams_deg",
       .type = Type::numbers,
       .about = "first and last beam, in degrees of the lidar's frame"},
      {.name = "cluster",
       .type = Type::integer,
       .about = "beams merged into one by the lidar",
       .min = 1,
       .max = 99},
      {.name = "spacing_s", .about = "time between samples; every scan if not given", .min = 0, .max = 3600},
      {.name = "intensity", .type = Type::flag, .about = "false leaves the intensities out"},
      {.name = "target", .type = Type::text, .about = "the bench's target that this is about"}};
}

CaptureRequest capture_request(const Arguments& arguments, const fit::Bench& bench, int samples) {
  CaptureRequest request;
  const fit::LidarGeometry& lidar = bench.lidar;
  request.samples = samples;
  request.first_step = lidar.first_step;
  request.last_step = lidar.steps - 1;
  if (const auto beams = arguments.interval("beams_deg");
      beams && !std::isnan(beams->first + beams->second)) {
    const double step_deg = lidar.step_rad * fit::deg_per_rad;
    const auto step = [&](double deg) {
      return static_cast<int>(std::lround(lidar.front_step + deg / step_deg));
    };
    if (step(beams->first) < lidar.first_step || step(beams->second) >= lidar.steps)
      throw ProcedureError(arguments.position_of("beams_deg"),
                           "the lidar sees from " +
                               to_text((lidar.first_step - lidar.front_step) * step_deg) + " to " +
                               to_text((lidar.steps - 1 - lidar.front_step) * step_deg) + " deg only.");
    request.first_step = step(beams->first);
    request.last_step = step(beams->second);
  }
  request.cluster = arguments.integer_or("cluster", 1);
  request.spacing_s = arguments.number_or("spacing_s", 0);
  request.intensity = arguments.flag_or("intensity", true);
  if (arguments.has("target")) {
    request.target = arguments.text_or("target", "");
    if (*request.target != "?" && !bench.target(*request.target)) {
      std::vector<std::string> names;
      std::string list;
      for (const auto& target : bench.targets) names.push_back(target.name), list += " " + target.name;
      const std::string meant = did_you_mean(*request.target, names);
      throw ProcedureError(
          arguments.position_of("target"),
          "the bench has no target '" + *request.target + "'" +
              (meant.empty() ? "; it has:" + list + "." : "; did you mean '" + meant + "'?"));
    }
  }
  return request;
}

Option approach_option() {
  return {.name = "approach",
          .type = Option::Type::choice,
          .about =
              "side from which the stage comes to every stop, which takes up its backlash; direct: the "
              "shortest way",
          .choices = {"positive", "negative", "direct"}};
}

int approach_of(const Arguments& arguments, int otherwise) {
  const std::string word = arguments.text_or("approach", "");
  return word == "positive" ? 1 : word == "negative" ? -1 : word == "direct" ? 0 : otherwise;
}

}  // namespace rig
