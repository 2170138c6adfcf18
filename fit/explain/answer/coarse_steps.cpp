// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <string>

#include "fit/explain/answer/chapters.hpp"

namespace fit::explain::answer {
namespace {

/// Log odds against one mechanism of the catalogue, asked for by itself: against any one of all, where
/// whoever asks suspects something.
constexpr double against_any = 4.0 - 1.8;

Found found_steps(const Suspect& suspect) {
  constexpr double by_chance = 4;  // of the gain
  Found found;
  found.mechanism = suspect.mechanism;
  found.parameters = suspect.parameters;
  found.probability = std::min(0.999, 1 / (1 + std::exp(against_any - (suspect.gain - by_chance))));
  found.says = suspect.mechanism->says(found);
  // What Akaike expects of other captures.
  found.log_likelihood_gain = suspect.gain - static_cast<double>(suspect.parameters.size());
  found.gain_is_expected = true;
  found.evidence = "Its log-likelihood is higher by " + rounded(suspect.gain, 3) + ", of which " +
                   rounded(by_chance, 2) + " would be chance.";
  return found;
}

}  // namespace

void report_coarse_steps(const Reduced& reduced, const Inferred& inferred, Explanation& out) {
  const auto steps = std::ranges::find(inferred.accepted, find_mechanism("rounding"), &Suspect::mechanism);
  if (steps == inferred.accepted.end() || reduced.bench.knows(steps->mechanism->id)) return;
  out.mechanisms.push_back(found_steps(*steps));
  out.after.log_likelihood += out.mechanisms.back().log_likelihood_gain;
  out.bench.known.push_back({steps->mechanism->id, steps->parameters, {}});
}

}  // namespace fit::explain::answer
