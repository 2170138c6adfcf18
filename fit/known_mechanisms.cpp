// SPDX-License-Identifier: MIT
#include "fit/known_mechanisms.hpp"

#include <algorithm>
#include <set>
#include <stdexcept>
#include <string>

#include "fit/bench/json_position.hpp"
#include "fit/mechanism.hpp"

namespace fit {
namespace {

void demand_parameters(const KnownMechanism& known, const Mechanism& mechanism) {
  // What else a radiometry says is read by claimed_intensity().
  if (mechanism.id == "radiometry") return;
  std::set<std::string> names;
  for (const Parameter& parameter : mechanism.parameters) names.insert(parameter.name);
  const bool all_given =
      std::ranges::all_of(names, [&](const std::string& name) { return known.parameters.contains(name); });
  if (all_given) return;
  for (const auto& [name, value] : known.parameters) {
    if (names.contains(name)) continue;
    std::string list;
    for (const Parameter& parameter : mechanism.parameters)
      list += (list.empty() ? "" : ", ") + parameter.name;
    throw std::invalid_argument("the bench's " + known.mechanism + " has a parameter \"" + name +
                                "\", which this mechanism does not have; it has " + list);
  }
}

/// A mechanism of a target that is not there would act nowhere.
void demand_target(const KnownMechanism& known, const Bench& bench) {
  const auto named = known.texts.find("target");
  if (named == known.texts.end()) return;
  std::set<std::string> names;
  for (const Target& target : bench.targets) names.insert(target.name);
  if (names.contains(named->second)) return;
  throw std::invalid_argument("the bench's " + known.mechanism + " is of the target \"" + named->second +
                              "\", which the bench does not have" +
                              ending_with_guess(nearest_word(named->second, names)));
}

}  // namespace

void demand_catalogued(const Bench& bench) {
  for (const KnownMechanism& known : bench.known) {
    demand_target(known, bench);
    if (const Mechanism* mechanism = find_mechanism(known.mechanism)) {
      demand_parameters(known, *mechanism);
      continue;
    }
    std::set<std::string> ids;
    for (const Mechanism& one : catalogue()) ids.insert(one.id);
    throw std::invalid_argument("the bench knows the mechanism \"" + known.mechanism +
                                "\", which the catalogue does not have" +
                                ending_with_guess(nearest_word(known.mechanism, ids)));
  }
}

}  // namespace fit
