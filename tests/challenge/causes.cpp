// SPDX-License-Identifier: MIT
// Concealed physics, made from causes: pulses on thresholds, disks off their axes, gears with play. Nothing
// here uses the effect-level formulas of fit/; where both agree it is because the physics does.
#include <array>
#include <stdexcept>

#include "cause_entry.hpp"

namespace challenge {
namespace {

std::array<const Entries*, 4> all_entries() {
  return {&causes_of_range(), &causes_of_geometry(), &causes_of_noise(), &outside_the_catalogue()};
}

}  // namespace

std::shared_ptr<Cause> make_cause(const std::string& id) {
  for (const Entries* entries : all_entries())
    for (const auto& [name, entry] : *entries) {
      if (name != id) continue;
      auto cause = entry.make();
      cause->id = id;
      cause->coordinate = entry.coordinate;
      return cause;
    }
  throw std::invalid_argument("unknown kind '" + id + "'; --list shows them");
}

const std::vector<std::pair<std::string, std::vector<std::string>>>& cause_scenes() {
  static const auto list = [] {
    std::vector<std::pair<std::string, std::vector<std::string>>> all;
    for (const Entries* entries : all_entries())
      for (const auto& [name, entry] : *entries) all.emplace_back(name, entry.scenes);
    return all;
  }();
  return list;
}

}  // namespace challenge
