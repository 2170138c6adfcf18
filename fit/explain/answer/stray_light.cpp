// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <iterator>

#include "fit/explain/answer/chapters.hpp"

namespace fit::explain::answer {
namespace {

/// Largest change of a range by stray light, mm.
double largest_pull(const Reduced& reduced, double leak) {
  double largest = 0;
  for (const Cell& cell : reduced.cells)
    if (const double pulled = leak * cell.at.pull_mm; cell.n > 0 && std::abs(pulled) > std::abs(largest))
      largest = pulled;
  return largest;
}

Found found_light(const Findings& findings, const Suspect& suspect) {
  Finding finding;
  finding.parameters = suspect.parameters;
  finding.largest_mm = largest_pull(findings.reduced, suspect.parameters.at("leak").value);
  Found found;
  found.mechanism = suspect.mechanism;
  found.parameters = suspect.parameters;
  found.probability = std::min(0.999, 1 / (1 + std::exp(-suspect.evidence)));
  found.says = suspect.mechanism->says(finding);
  found.log_likelihood_gain = suspect.gain - 1;
  found.gain_is_expected = true;
  found.evidence =
      "Beams beside edges are pulled by the light of the other surface: the log-likelihood is higher by " +
      rounded(suspect.gain, 3) + ", and more than by a beam that is too wide.";
  found.rms_before_mm = findings.means.after.rms_mm;
  found.rms_after_mm = findings.means.after.rms_mm;
  return found;
}

}  // namespace

void report_stray_light(const Findings& findings, Explanation& out) {
  if (!findings.light) return;
  const StrayLight& light = *findings.light;
  if (light.or_mixed_pixel && out.bench.knows(wide_beam)) return;
  std::ranges::copy(light.located, std::back_inserter(out.located));
  if (light.or_mixed_pixel) {
    out.undecided_between.push_back({crosstalk, wide_beam});
    out.edge_suspects = {light.suspect.parameters.at("leak").value, light.width_deg};
  } else {
    out.add_beside_means(found_light(findings, light.suspect));
  }
}

}  // namespace fit::explain::answer
