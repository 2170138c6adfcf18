// SPDX-License-Identifier: MIT
#include "fit/explain/spread.hpp"

#include <vector>

#include "fit/explain/spread/flicker.hpp"
#include "fit/explain/spread/questions.hpp"
#include "fit/explain/spread/regular_patterns.hpp"
#include "fit/explain/spread/suspects.hpp"

namespace fit::explain {

namespace {

/// What single samples do, once it is known what whole scans do.
void samples(const Reduced& reduced, double step_mm, double worth_of_sample, SpreadResult& result) {
  spread::variance(reduced, step_mm, worth_of_sample, result);
  spread::distrust_beside_coarse_steps(reduced, result);
  spread::losses(reduced, result);
  spread::may_be_near_threshold(reduced, result);
}

}  // namespace

SpreadResult explain_spread(const Reduced& reduced) {
  SpreadResult result;
  const double step_mm = spread::output_steps(reduced, result);
  spread::strays(reduced, result);
  spread::edges(reduced, result);
  // What whole scans have in common, the regular before the random.
  std::vector<Sector> sectors = reduced.sectors;
  const std::size_t unknown_before = result.unknown.size();
  spread::flicker(reduced.groups, sectors, result);
  spread::swinging(reduced.groups, sectors, result);
  std::vector<spread::Scan> scans = spread::scans_of(reduced.groups, sectors);
  spread::scan_numbers(scans, result);
  const bool has_unknown_pattern = result.unknown.size() > unknown_before;
  const bool is_regular = has_unknown_pattern || spread::is_accepted(result, spread::ids::facet_wobble);
  if (!has_unknown_pattern) spread::common_noise(scans, reduced, result);
  const double worth_of_sample = is_regular ? 1 : spread::memory(reduced.groups, result);
  if (spread::flickers(result) || is_regular || spread::is_accepted(result, spread::ids::settling)) {
    Reduced rest = reduced;
    if (spread::flickers(result)) spread::take_off_flicker(rest);
    spread::take_off_patterns(result, rest);
    samples(rest, step_mm, worth_of_sample, result);
  } else {
    samples(reduced, step_mm, worth_of_sample, result);
  }
  spread::distrust_beside_patterns(result);
  return result;
}

}  // namespace fit::explain
