// SPDX-License-Identifier: MIT
#include "rig/session/step_in_words.hpp"

#include <algorithm>
#include <array>
#include <regex>
#include <utility>

#include "rig/text_lines.hpp"

namespace rig {
namespace {

/// "distance_mm=500": "500 mm"; "beam_deg=92": "beam 92 deg"; "surface=white paper": "white paper".
std::string turn_in_words(const std::string& turn) {
  static constexpr std::array<std::pair<const char*, const char*>, 6> units = {
      {{"_deg_s", "deg/s"}, {"_mm", "mm"}, {"_deg", "deg"}, {"_hz", "Hz"}, {"_c", "\u00b0C"}, {"_s", "s"}}};
  const std::size_t equals = turn.find('=');
  if (equals == std::string::npos) return turn;
  std::string name = turn.substr(0, equals), value = turn.substr(equals + 1);
  if (!number_in(value)) return value;
  for (const auto& [ending, unit] : units) {
    if (!name.ends_with(ending)) continue;
    name.erase(name.size() - std::string(ending).size());
    value += std::string(" ") + unit;
    break;
  }
  std::ranges::replace(name, '_', ' ');
  return name == "distance" || name.empty() ? value : name + " " + value;
}

}  // namespace

std::string step_in_words(const std::string& step) {
  static const std::regex planned(R"(([a-z-]+) (\d+(?:\.\d+)*)((?:\[[^\[\]]*\])*)( \(short\))?)");
  static const std::regex turn(R"(\[([^\[\]]*)\])");
  // The library's search needs stack for every character, and a stranger's session may have any name.
  constexpr std::size_t longest = 500;
  if (step.size() > longest) return step;
  std::smatch parts;
  if (!std::regex_match(step, parts, planned)) return step;
  std::string words = (parts[1] == "capture" ? "" : parts[1].str() + ", ") + "step " + parts[2].str();
  const std::string turns = parts[3];
  for (std::sregex_iterator at(turns.begin(), turns.end(), turn), end; at != end; ++at)
    words += ", " + turn_in_words((*at)[1]);
  return words + parts[4].str();
}

}  // namespace rig
