// SPDX-License-Identifier: MIT
#include <cmath>

#include "fit/bench/json_position.hpp"
#include "rig/procedure/step.hpp"

namespace rig::steps {
namespace {

using Type = Option::Type;

const std::vector<Option>& ask_options() {
  static const std::vector<Option> options = {
      {.name = "name", .type = Type::text, .about = "variable that receives the answer", .required = true},
      {.name = "unit", .type = Type::text, .about = "unit of the answer"},
      {.name = "min", .about = "smallest answer that is accepted"},
      {.name = "max", .about = "largest answer that is accepted"},
      {.name = "default", .type = Type::text, .about = "answer of unattended runs"}};
  return options;
}

const std::vector<Option>& place_options() {
  static const std::vector<Option> options = {
      {.name = "target", .type = Type::text, .about = "which of the bench's targets is changed"},
      {.name = "shift_mm", .about = "how far from its place in the bench file, away from the axis"},
      {.name = "at_mm", .about = "or its distance from the stage's axis"},
      {.name = "reflectance", .about = "of the surface put there", .min = 0, .max = 10},
      {.name = "temperature_c", .about = "of the lidar's housing", .min = -40, .max = 90},
      {.name = "since_power_on_s",
       .about = "the lidar was switched off; how long it has been on again when this is confirmed",
       .min = 0,
       .max = 1e6}};
  return options;
}

const std::vector<Option>& until_options() {
  static const std::vector<Option> options = {
      {.name = "beams_deg",
       .type = Type::numbers,
       .about = "beams that are checked, in degrees of the lidar's frame; a placed target is checked anyway"},
      {.name = "within_mm", .type = Type::numbers, .about = "distance they should see"},
      {.name = "flat_within_mm", .about = "largest deviation from a straight line", .min = 0.1},
      {.name = "tolerance_mm",
       .about =
           "how far from its place a placed target may be seen; from the stated uncertainties if not given",
       .min = 0.1,
       .max = 1e5},
      {.name = "surface",
       .type = Type::flag,
       .about = "false: the echo need not follow the reflectance of 'place'"},
      {.name = "echo",
       .type = Type::flag,
       .about =
           "false: a placed target that gives no echo at all is accepted: it may be too dark or too far"}};
  return options;
}

constexpr double nearest_mm = 20;  // Below the least range of every lidar that the sources name.

/// Distance of the target's plane from the stage's axis.
double distance_mm(const fit::Target& target) { return target.from_mm.dot(target.outward_normal()); }

Placement placement(const Arguments& place, const fit::Bench& bench) {
  Placement result;
  result.target = place.text_or("target", "");
  result.shift_mm = place.maybe_number("shift_mm");
  result.reflectance = place.maybe_number("reflectance");
  result.temperature_c = place.maybe_number("temperature_c");
  result.since_power_on_s = place.maybe_number("since_power_on_s");
  const auto at_mm = place.maybe_number("at_mm");
  if (result.target.empty()) {
    if (result.shift_mm || at_mm || result.reflectance)
      throw ProcedureError(place.position(), "'place' needs 'target': which one is changed.");
    return result;
  }
  const fit::Target* target = bench.target(result.target);
  if (!target) {
    std::vector<std::string> names;
    for (const auto& each : bench.targets) names.push_back(each.name);
    throw ProcedureError(place.position_of("target"),
                         "the bench has no target '" + result.target + "'" +
                             fit::ending_with_guess(did_you_mean(result.target, names)));
  }
  if (at_mm && result.shift_mm)
    throw ProcedureError(place.position(), "'place' takes one of at_mm and shift_mm.");
  if (at_mm && *at_mm < nearest_mm)
    throw ProcedureError(place.position_of("at_mm"),
                         to_text(*at_mm) + " mm from the stage's axis is nearer than any lidar measures (" +
                             to_text(nearest_mm) + " mm). Lengths are in millimetres; were metres meant?");
  if (at_mm) result.shift_mm = *at_mm - distance_mm(*target);
  return result;
}

class PromptStep final : public StepKind {
 public:
  std::string name() const override { return "prompt"; }
  bool asks_a_person() const override { return true; }
  const Node* places(const Node& options) const override { return options.find("place"); }
  std::string about() const override {
    return "Asks the operator to place or change something; the rig checks that it was done";
  }
  const std::vector<Option>& options() const override {
    static const std::vector<Option> options = {
        {.name = "title", .type = Type::text, .about = "what to do, in a few words", .required = true},
        {.name = "text", .type = Type::text, .about = "exactly what to put where"},
        {.name = "picture", .type = Type::text, .about = "picture shown with it"},
        {.name = "ask",
         .type = Type::map,
         .about = "a number that the operator types",
         .members = ask_options()},
        {.name = "place",
         .type = Type::map,
         .about = "what changes, for simulated benches and the record",
         .members = place_options()},
        {.name = "until",
         .type = Type::map,
         .about = "what the rig itself should then see, besides a placed target where it was requested",
         .members = until_options()},
        {.name = "timeout_min",
         .about = "stops the run, resumable, when nobody answers; waits indefinitely if not given",
         .min = 0.01,
         .max = 100000},
        {.name = "skip",
         .type = Type::flag,
         .about = "false: may not be skipped (a skip leaves out this repetition of the for-each)"}};
    return options;
  }
  std::vector<std::string> defines(const Node& options) const override {
    const Node* ask = options.find("ask");
    const Node* name = ask ? ask->find("name") : nullptr;
    return name ? std::vector{name->scalar} : std::vector<std::string>{};
  }
  void plan(const Arguments& arguments, Plan& plan) const override {
    (void)prompt(arguments, *plan.bench);
    plan.seconds += 30;
    plan.says = "prompt: " + arguments.text_or("title", "");
  }
  awaitable<void> run(const Arguments& arguments, StepContext& context) const override {
    const Prompt asked = prompt(arguments, context.bench());
    const Answer answer = co_await context.ask(asked);
    if (answer.kind == Answer::Kind::skipped) context.skip_rest_of_iteration();
    if (answer.kind == Answer::Kind::confirmed && asked.question && answer.value)
      context.set(asked.question->name, *answer.value);
  }

 private:
  static Prompt prompt(const Arguments& arguments, const fit::Bench& bench) {
    Prompt result;
    result.title = arguments.text_or("title", "");
    result.text = arguments.text_or("text", "");
    result.picture = arguments.text_or("picture", "");
    result.timeout_s = 60 * arguments.number_or("timeout_min", 0);
    result.skippable = arguments.flag_or("skip", true);
    if (arguments.has("ask")) result.question = question(arguments.map("ask"));
    if (arguments.has("place")) result.place = placement(arguments.map("place"), bench);
    const bool places_target = result.place && !result.place->target.empty();
    if (arguments.has("until"))
      result.until = expected(arguments.map("until"), bench, places_target);
    else if (places_target)
      result.until.emplace().of_target = true;
    return result;
  }

  static Question question(const Arguments& ask) {
    Question result;
    result.name = ask.text_or("name", "");
    result.unit = ask.text_or("unit", "");
    result.min = ask.maybe_number("min");
    result.max = ask.maybe_number("max");
    if (ask.has("default")) result.otherwise = ask.value(*ask.node().find("default"));
    return result;
  }

  static Expectation expected(const Arguments& until, const fit::Bench& bench, bool places_target) {
    (void)capture_request(until, bench, 1);  // checks that the lidar has these beams
    Expectation result;
    result.tolerance_mm = until.maybe_number("tolerance_mm");
    result.surface = until.flag_or("surface", true);
    result.echo = until.flag_or("echo", true);
    result.of_target = places_target;
    const auto beams = until.interval("beams_deg");
    if (!beams) {
      if (!places_target || until.has("within_mm") || until.has("flat_within_mm"))
        throw ProcedureError(until.position(),
                             "'until' needs 'beams_deg', the beams that check it; only a target that 'place' "
                             "names is checked without them.");
      return result;
    }
    if (result.tolerance_mm && !places_target)
      throw ProcedureError(
          until.position_of("tolerance_mm"),
          "tolerance_mm is about the target that 'place' names; there is none. For beams_deg "
          "give within_mm.");
    result.of_beams = true;
    result.from_deg = beams->first;
    result.to_deg = beams->second;
    result.within_mm = until.interval("within_mm");
    result.flat_within_mm = until.maybe_number("flat_within_mm");
    return result;
  }
};

}  // namespace

std::unique_ptr<StepKind> make_prompt();
std::unique_ptr<StepKind> make_prompt() { return std::make_unique<PromptStep>(); }

}  // namespace rig::steps
