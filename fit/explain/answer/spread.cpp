// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "fit/explain/answer/chapters.hpp"
#include "fit/explain/odds.hpp"
#include "fit/explain/spread/suspects.hpp"
#include "fit/explain/stated_noise.hpp"

namespace fit::explain::answer {
namespace {

/// Whether a name was found beside noise that is not decided, or that nobody knows: with another of its
/// suspects in place, less might be left for the name. What the bench states of the constant noise is no such
/// name.
bool may_be_of_the_undecided(const Suspect& suspect, const SpreadResult& spread) {
  const bool is_open = !spread.undecided.empty() || std::ranges::any_of(spread.unknown, [](const auto& u) {
    return u.observable == Observable::range_variance;
  });
  return is_open && suspect.mechanism->observable == Observable::range_variance &&
         !is_constant_noise(*suspect.mechanism);
}

/// Whether the formula of other noise may be wrong by more than a name explains.
bool may_be_of_a_formula(const Suspect& suspect, const SpreadResult& spread) {
  const auto is_law = [](const Suspect& s) {
    return s.mechanism->observable == Observable::range_variance && !is_constant_noise(*s.mechanism);
  };
  return is_law(suspect) && std::ranges::any_of(spread.accepted, [&](const Suspect& other) {
           return is_law(other) && spread::may_be_of_its_formula(other) > suspect.gain;
         });
}

Found found_noise(const Findings& findings, const Suspect& suspect) {
  Finding finding;
  finding.parameters = suspect.parameters;
  Found found;
  found.mechanism = suspect.mechanism;
  found.parameters = suspect.parameters;
  found.probability =
      std::min(0.999, 1 / (1 + std::exp(odds::against_any - suspect.evidence) + std::exp(-suspect.ahead)));
  if (may_be_of_the_undecided(suspect, findings.spread) || may_be_of_a_formula(suspect, findings.spread))
    found.probability = std::min(not_certain, found.probability);
  found.says = suspect.mechanism->says(finding);
  // Where no other capture says it: what Akaike expects of others.
  found.log_likelihood_gain =
      suspect.held_out_gain.value_or(suspect.gain - static_cast<double>(suspect.parameters.size()));
  found.gain_is_expected = !suspect.held_out_gain;
  found.evidence = "Its log-likelihood is higher by " + rounded(suspect.gain, 3) + ", of which " +
                   rounded(suspect.gain - suspect.evidence, 2) + " would be chance" +
                   (suspect.held_out_gain ? "; in captures that it was not fitted to, by " +
                                                rounded(*suspect.held_out_gain, 3) + "."
                                          : std::string("."));
  found.rms_before_mm = findings.means.after.rms_mm;
  found.rms_after_mm = findings.means.after.rms_mm;
  return found;
}

void tell_set(const std::vector<Suspect>& set, Explanation& out) {
  std::vector<std::string> names, ways;
  const auto named = std::ranges::count_if(set, [](const Suspect& s) { return s.mechanism != nullptr; });
  for (const Suspect& s : set) {
    if (!s.mechanism) continue;
    names.push_back(s.mechanism->id);
    if (named > 1) out.noise_suspects.push_back(s);  // else there is nobody to tell it from
    if (!std::ranges::count(ways, s.mechanism->separate)) ways.push_back(s.mechanism->separate);
  }
  out.notes.push_back("What would tell " + listed(names) + " apart: " + listed(ways, "or") + ".");
  if (names.size() < set.size()) names.emplace_back(unknown_physics);
  out.undecided_between.push_back(names);
}

}  // namespace

void tell_spread(const Findings& findings, Explanation& out) {
  const auto add_to_bench = [&](const Suspect& s) {
    out.bench.known.push_back({s.mechanism->id, s.parameters, {}});
  };
  for (const Suspect& suspect : findings.spread.accepted) {
    const bool is_constant = is_constant_noise(*suspect.mechanism);
    if (findings.reduced.bench.knows(suspect.mechanism->id) && !is_constant) continue;
    out.add_beside_means(found_noise(findings, suspect));
    if (!is_constant) add_to_bench(suspect);
  }
  for (const Suspect& suspect : findings.spread.brought_along) {
    add_to_bench(suspect);
    out.notes.push_back("Echoes that are about to be lost scatter more; that is no other physics.");
  }
  for (const std::vector<Suspect>& set : findings.spread.undecided) tell_set(set, out);
  out.spread_curves = findings.spread.curves;
}

}  // namespace fit::explain::answer
