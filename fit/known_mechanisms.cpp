// SPDX-License-Identifier: MIT
#include "fit/known_mechanisms.hpp"

#include <algorithm>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

#include "fit/bench/empirical.hpp"
#include "fit/bench/json_position.hpp"

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

/// What is of a target that is not there would act nowhere.
void demand_target(const std::string& what, const std::string& target, const Bench& bench) {
  std::set<std::string> names;
  for (const Target& one : bench.targets) names.insert(one.name);
  if (names.contains(target)) return;
  throw std::invalid_argument("the bench's " + what + " is of the target \"" + target +
                              "\", which the bench does not have" +
                              ending_with_guess(nearest_word(target, names)));
}

}  // namespace

void demand_catalogued(const Bench& bench) {
  for (const KnownMechanism& known : bench.known) {
    const auto target = known.texts.find("target");
    if (target != known.texts.end()) demand_target(known.mechanism, target->second, bench);
    if (const Mechanism* mechanism = find_mechanism(known.mechanism)) {
      demand_parameters(known, *mechanism);
      if (mechanism->one_target && target == known.texts.end())
        throw std::invalid_argument("the bench's " + known.mechanism +
                                    " is of one target: say of which by \"target\": \"its name\"");
      continue;
    }
    std::set<std::string> ids;
    for (const Mechanism& one : catalogue()) ids.insert(one.id);
    throw std::invalid_argument("the bench knows the mechanism \"" + known.mechanism +
                                "\", which the catalogue does not have" +
                                ending_with_guess(nearest_word(known.mechanism, ids)));
  }
  for (const EmpiricalFunction& f : empirical_functions(bench))
    if (!f.target.empty()) demand_target("\"empirical\" function", f.target, bench);
}

KnownMechanism as_known(const Mechanism& mechanism, std::map<std::string, Estimate> parameters,
                        const std::string& target) {
  KnownMechanism known{mechanism.id, std::move(parameters), {}};
  if (!target.empty()) known.texts["target"] = target;
  return known;
}

void add_known(Bench& bench, KnownMechanism known) {
  const Mechanism* mechanism = find_mechanism(known.mechanism);
  const auto stated = std::ranges::find(bench.known, known.mechanism, &KnownMechanism::mechanism);
  if (mechanism && mechanism->corrects_a_statement && stated != bench.known.end())
    stated->parameters.insert(known.parameters.begin(), known.parameters.end());
  else
    bench.known.push_back(std::move(known));
}

std::vector<Active> known_to_be_at_work(const Bench& bench) {
  std::vector<Active> list;
  for (const KnownMechanism& known : bench.known) {
    const Mechanism* m = find_mechanism(known.mechanism);
    if (!m) continue;
    Active active{not_owned(*m), m->values(known.parameters)};
    for (const Parameter& p : m->parameters) {
      const auto found = known.parameters.find(p.name);
      active.sigma.push_back(found == known.parameters.end() ? p.u_left_out() : found->second.u);
    }
    const auto name = known.texts.find("target");
    const Target* target = name == known.texts.end() ? nullptr : bench.target(name->second);
    if (target)
      active.target = static_cast<int>(target - bench.targets.data());
    else if (m->one_target || name != known.texts.end())
      continue;
    list.push_back(std::move(active));
  }
  for (const EmpiricalFunction& f : empirical_functions(bench))
    if (moves_or_dims(f) && (f.target.empty() || bench.target(f.target)))
      list.push_back({std::make_shared<const Mechanism>(as_mechanism(f, bench)), {}});
  return list;
}

}  // namespace fit
