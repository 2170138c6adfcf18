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

Found found_noise(const Findings& findings, const Suspect& suspect) {
  Found found;
  found.mechanism = suspect.mechanism;
  found.parameters = suspect.parameters;
  found.probability = std::min(0.999, 1 / (1 + std::exp(against_any - suspect.evidence)));
  found.says = suspect.mechanism->says(found);
  // What Akaike expects of other captures.
  found.log_likelihood_gain = suspect.gain - static_cast<double>(suspect.parameters.size());
  found.gain_is_expected = true;
  found.evidence = "Its log-likelihood is higher by " + rounded(suspect.gain, 3) + ", of which " +
                   rounded(suspect.gain - suspect.evidence, 2) + " would be chance.";
  found.rms_before_mm = findings.means.after.rms_mm;
  found.rms_after_mm = findings.means.after.rms_mm;
  return found;
}

}  // namespace

void report_spread(const Findings& findings, Explanation& out) {
  for (const Suspect& suspect : findings.spread.accepted) {
    if (findings.reduced.bench.knows(suspect.mechanism->id)) continue;
    out.add_beside_means(found_noise(findings, suspect));
    out.bench.known.push_back({suspect.mechanism->id, suspect.parameters, {}});
  }
}

}  // namespace fit::explain::answer
