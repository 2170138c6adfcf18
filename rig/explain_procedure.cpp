// SPDX-License-Identifier: MIT
#include "rig/explain_procedure.hpp"

#include <cmath>
#include <cstdio>

namespace rig {
namespace {

using fit::CaptureInfo;
using fit::explain::Experiment;

std::string text_of(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.10g", std::round(value * 1e4) / 1e4);
  return text;
}

/// As a quoted YAML scalar.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + "\"";
}

std::string deg(double rad) { return text_of(rad * fit::deg_per_rad); }

std::string beams_of(const CaptureInfo& c) {
  // Beam angles of the UST-10LX; others differ only in where the whole scene ends, which is left out then.
  if (!c.target) return "";
  return ", beams_deg: [" + text_of((c.first_step - 540) * 0.25) + ", " +
         text_of((c.last_step - 540) * 0.25) + "]";
}

/// A target that people put up anew: where, and how well.
std::string put_up_step(const CaptureInfo& c) {
  const std::string name = *c.target;
  const std::string shift = text_of(c.target_shift_mm);
  std::string place = "{target: " + quoted(name) + ", shift_mm: " + shift, cover;
  if (c.reflectance) {
    place += ", reflectance: " + text_of(*c.reflectance);
    cover = " Cover it with a surface of reflectance " + text_of(*c.reflectance) + ".";
  }
  return "  - prompt:\n      title: " + quoted(name + ": " + shift + " mm from its place") +
         "\n      text: " +
         quoted("Put '" + name + "' up " + shift +
                " mm farther away than the bench file has it (less than nothing: nearer), square to the "
                "lidar, and measure the distance at least as well as the bench file says." +
                cover) +
         "\n      place: " + place + "}\n";
}

std::string place_step(const CaptureInfo& c) {
  const std::string name = *c.target;
  const std::string rho = text_of(c.reflectance.value_or(0.5)), shift = text_of(c.target_shift_mm);
  return "  - prompt:\n      title: " + quoted(name + ": " + shift + " mm out, reflectance " + rho) +
         "\n      text: " +
         quoted(
             "Move '" + name + "' " + shift +
             " mm from its place in the bench file, along its normal away from the axis, and cover it with a "
             "surface of reflectance " +
             rho + ".") +
         "\n      place: {target: " + quoted(name) + ", shift_mm: " + shift + ", reflectance: " + rho + "}\n";
}

std::string heat_step(double celsius) {
  const std::string t = text_of(celsius);
  return "  - prompt:\n      title: " + quoted("Lidar's housing at " + t + " C") + "\n      text: " +
         quoted("Bring the lidar's housing to " + t + " C and hold it there for ten minutes.") +
         "\n      place: {temperature_c: " + t + "}\n";
}

std::string steps_of(const Experiment& e) {
  std::string steps;
  const std::string samples = std::to_string(e.scans);
  switch (e.kind) {
    case Experiment::Kind::all_round:
    case Experiment::Kind::both_sides:
      for (const CaptureInfo& c : e.captures)
        steps += "  - move: {to_deg: " + deg(c.stage_rad) + "}\n  - capture: {samples: " + samples + "}\n";
      break;
    case Experiment::Kind::ladder:
    case Experiment::Kind::greys:
      for (const CaptureInfo& c : e.captures)
        if (e.by_hand)
          steps +=
              put_up_step(c) + "  - capture: {samples: " + samples + ", target: " + quoted(*c.target) + "}\n";
      if (e.by_hand) break;
      steps += "  - move: {to_deg: 0}\n";
      for (const CaptureInfo& c : e.captures)
        steps += place_step(c) + "  - capture: {samples: " + samples + ", target: " + quoted(*c.target) +
                 beams_of(c) + "}\n";
      break;
    case Experiment::Kind::heat:
      steps += "  - move: {to_deg: 0}\n";
      for (const CaptureInfo& c : e.captures)
        steps += heat_step(c.temperature_c.value_or(25)) + "  - capture: {samples: " + samples + "}\n";
      break;
    case Experiment::Kind::cold_start:
      steps += "  - move: {to_deg: 0}\n";
      steps +=
          "  - prompt:\n      title: \"Cold start\"\n      text: \"Switch the lidar off for two hours, hold "
          "its housing "
          "at 25 C, switch it on and confirm at once.\"\n      place: {temperature_c: 25}\n";
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

}  // namespace

std::string procedure_text(const Experiment& e, const std::string& suspects) {
  const bool both = e.kind == Experiment::Kind::all_round || e.kind == Experiment::Kind::both_sides;
  return "procedure: next-experiment\ntitle: " + quoted(e.title) + "\nabout: " +
         quoted("Separates " + suspects + ": the odds between them are expected to become e^" +
                std::to_string(std::lround(std::min(e.expected, 9999.0))) +
                " or more. Afterwards: rig explain THE-SESSION-SO-FAR.rig THE-NEW-ONE.rig") +
         (e.by_hand ? std::string("\nsteps:\n")
                    : std::string("\nstage: {approach: ") + (both ? "direct" : "positive") +
                          ", margin_deg: 0.5}\nsteps:\n  - home\n") +
         steps_of(e);
}

}  // namespace rig
