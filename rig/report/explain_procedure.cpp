// SPDX-License-Identifier: MIT
#include "rig/report/explain_procedure.hpp"

#include <cmath>
#include <cstdio>

namespace rig {
namespace {

using fit::CaptureInfo;
using fit::explain::Experiment;
using fit::explain::listed;

std::string yaml_number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.10g", std::round(value * 1e4) / 1e4);
  return text;
}

std::string deg(double rad) { return yaml_number(rad * fit::deg_per_rad); }

std::string beams_of(const CaptureInfo& c, const fit::LidarGeometry& lidar) {
  if (!c.target) return "";
  return ", beams_deg: [" + deg(lidar.beam_angle(c.first_step)) + ", " + deg(lidar.beam_angle(c.last_step)) +
         "]";
}

/// A target that people put up anew: where, and how well.
std::string put_up_step(const CaptureInfo& c) {
  const std::string name = *c.target;
  const std::string shift = yaml_number(c.target_shift_mm);
  std::string place = "{target: " + yaml_quoted(name) + ", shift_mm: " + shift, cover;
  if (c.reflectance) {
    place += ", reflectance: " + yaml_number(*c.reflectance);
    cover = " Cover it with a surface of reflectance " + yaml_number(*c.reflectance) + ".";
  }
  return "  - prompt:\n      title: " + yaml_quoted(name + ": " + shift + " mm from its place") +
         "\n      text: " +
         yaml_quoted("Put '" + name + "' up " + shift +
                     " mm farther away than the bench file has it (negative: nearer), square to the "
                     "lidar, and measure the distance at least as well as the bench file says." +
                     cover) +
         "\n      place: " + place + "}\n";
}

std::string place_step(const CaptureInfo& c) {
  const std::string name = *c.target;
  const std::string rho = yaml_number(c.reflectance.value_or(0.5)), shift = yaml_number(c.target_shift_mm);
  return "  - prompt:\n      title: " + yaml_quoted(name + ": " + shift + " mm out, reflectance " + rho) +
         "\n      text: " +
         yaml_quoted(
             "Move '" + name + "' " + shift +
             " mm from its place in the bench file, along its normal away from the axis, and cover it with a "
             "surface of reflectance " +
             rho + ".") +
         "\n      place: {target: " + yaml_quoted(name) + ", shift_mm: " + shift + ", reflectance: " + rho +
         "}\n      until: {echo: false}\n";  // Lost echoes may be what is in question.
}

/// In degrees Celsius.
std::string temperature_of(const CaptureInfo& c) {
  return yaml_number(c.temperature_c.value_or(fit::explain::steady_c));
}

std::string heat_step(const CaptureInfo& c) {
  const std::string t = temperature_of(c);
  return "  - prompt:\n      title: " + yaml_quoted("Lidar's housing at " + t + " C") + "\n      text: " +
         yaml_quoted("Bring the lidar's housing to " + t + " C and hold it there for ten minutes.") +
         "\n      place: {temperature_c: " + t + "}\n";
}

std::string cold_step(const CaptureInfo& c) {
  const std::string t = temperature_of(c);
  return "  - prompt:\n      title: \"Cold start\"\n      text: " +
         yaml_quoted("Switch the lidar off for two hours, hold its housing at " + t +
                     " C, switch it on and confirm at once.") +
         "\n      place: {temperature_c: " + t + ", since_power_on_s: 0}\n";
}

/// The lidar warm: what a drift is compared with.
std::string steady_step(const CaptureInfo& c) {
  const std::string t = temperature_of(c), since_s = yaml_number(c.since_power_on_s.value_or(0));
  return "  - prompt:\n      title: \"The lidar warm\"\n      text: " +
         yaml_quoted("Let the lidar be on for " + yaml_number(c.since_power_on_s.value_or(0) / 60) +
                     " minutes with its housing held at " + t + " C, then confirm.") +
         "\n      place: {temperature_c: " + t + ", since_power_on_s: " + since_s + "}\n";
}

}  // namespace

std::string yaml_quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + "\"";
}

std::string steps_text(const Experiment& e, const fit::LidarGeometry& lidar) {
  std::string steps;
  if (e.steady) steps += steady_step(e.captures.front());
  const std::string samples = std::to_string(e.scans);
  switch (e.kind) {
    case Experiment::Kind::all_round:
    case Experiment::Kind::both_sides:
      for (const CaptureInfo& c : e.captures)
        steps += "  - move: {to_deg: " + deg(c.stage_rad) + "}\n  - capture: {samples: " + samples + "}\n";
      break;
    case Experiment::Kind::ladder:
    case Experiment::Kind::greys:
    case Experiment::Kind::dark:
      for (const CaptureInfo& c : e.captures)
        if (e.by_hand)
          steps += put_up_step(c) + "  - capture: {samples: " + samples +
                   ", target: " + yaml_quoted(*c.target) + "}\n";
      if (e.by_hand) break;
      steps += "  - move: {to_deg: 0}\n";
      for (const CaptureInfo& c : e.captures)
        steps += place_step(c) + "  - capture: {samples: " + samples + ", target: " + yaml_quoted(*c.target) +
                 beams_of(c, lidar) + "}\n";
      break;
    case Experiment::Kind::heat:
      steps += "  - move: {to_deg: 0}\n";
      for (const CaptureInfo& c : e.captures)
        steps += heat_step(c) + "  - capture: {samples: " + samples + "}\n";
      break;
    case Experiment::Kind::cold_start:
      steps += "  - move: {to_deg: 0}\n";
      steps += cold_step(e.captures.front());
      steps += "  - for-each: {minute: {from: 1, to: " + std::to_string(e.captures.size()) +
               ", step: 1}}\n    steps:\n      - capture: {samples: " + samples +
               "}\n      - wait: {seconds: 59}\n";
      break;
    case Experiment::Kind::turning:
      for (const CaptureInfo& c : e.captures)
        steps += "  - turn: {rate_deg_s: " + deg(c.stage_rate_rad_s) + ", from_deg: " + deg(c.stage_rad) +
                 ", samples: " + samples + "}\n";
      break;
  }
  return steps;
}

std::string promise_of(const Experiment& e) {
  std::vector<std::string> groups, together;
  for (const auto& group : e.groups) {
    const std::vector<std::string> names = fit::explain::suspects_in_words(group);
    if (const std::string words = fit::explain::listed(names, "or");
        std::ranges::find(groups, words) == groups.end())
      groups.push_back(words);  // several may be physics without a name
    if (names.size() > 1) together.push_back(fit::explain::listed(names));
  }
  constexpr double million_to_one = 13.8;
  const std::string odds =
      e.expected > million_to_one
          ? "beyond doubt (more than a million to one)"
          : "with odds of about " + fit::rounded(std::exp(e.expected), 1) + " to one at least";
  if (e.groups.size() == 1)
    return "Narrows down which of " + together.front() + " it is, " + odds +
           " between two of them if what was found so far is right.";
  return "Tells apart " + fit::explain::listed(groups) + ", " + odds + " if what was found so far is right." +
         (together.empty() ? "" : " It does not separate " + fit::explain::listed(together) + ".");
}

std::string procedure_text(const Experiment& e, const fit::Bench& bench) {
  const bool both = e.kind == Experiment::Kind::all_round || e.kind == Experiment::Kind::both_sides;
  return "procedure: next-experiment\ntitle: " + yaml_quoted(e.title) + "\nabout: " +
         yaml_quoted(promise_of(e) + " Afterwards: rig explain THE-SESSION-SO-FAR.rig THE-NEW-ONE.rig") +
         (e.by_hand ? std::string("\nsteps:\n")
                    : std::string("\nstage: {approach: ") + (both ? "direct" : "positive") +
                          ", margin_deg: 0.5}\nsteps:\n  - home\n") +
         steps_text(e, bench.lidar);
}

}  // namespace rig
