// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/spread.hpp"
#include "fit/explain/spread/scans.hpp"

/// The questions that explain_spread asks of a recording, one file each, in their order. Each adds what it
/// finds to the result: mechanisms that are accepted, what the catalogue cannot explain, and the noise of
/// means.
namespace fit::explain::spread {

/// Do ranges come in coarse steps? Adds `rounding`. Returns the step, mm: 1 where ranges are whole
/// millimetres.
[[nodiscard]] double output_steps(const Reduced& reduced, SpreadResult& result);

/// Do samples lie far from their target? Adds `outliers`.
void strays(const Reduced& reduced, SpreadResult& result);

/// How gradually does the farther surface take over at edges? Adds `mixed-pixel`, and its width to the noise.
void edges(const Reduced& reduced, SpreadResult& result);

/// Does the stage still swing after a move: an angle that depends on the time since then, the same in every
/// capture? Adds `settling`, and takes the angle off the sectors.
void swinging(const std::vector<Group>& groups, std::vector<Sector>& sectors, SpreadResult& result);

/// Do common ranges depend on the scan's number only? Adds `facet-wobble`, and takes it off the scans, or
/// anything else as unknown.
void scan_numbers(std::vector<Scan>& scans, SpreadResult& result);

/// Takes the ranges of mirror faces off the sectors if they are believed, and by more than that evidence.
/// `scans` are those of the sectors.
[[nodiscard]] bool take_off_evident_faces(const std::vector<Scan>& scans, double least_evidence,
                                          std::vector<Sector>& sectors);

/// What random range and angle has a whole scan in common? Adds `angle-jitter` and `correlated-noise`, and
/// their variances, by scan and by group, to the noise.
void common_noise(const std::vector<Scan>& scans, const Reduced& reduced, SpreadResult& result);

/// Does a beam's noise remember earlier scans? Adds `correlated-noise`, and the factor to the noise. Returns
/// what a sample says of a variance in units of what one without memory says.
[[nodiscard]] double memory(const std::vector<Group>& groups, SpreadResult& result);

/// How large is the noise of one sample, and what does it depend on? Adds `intensity-noise`, `sunlight`,
/// `range-noise` and `angle-jitter`, or a set of these, and the constant noise. `step_mm` and
/// `worth_of_sample` are the answers of `output_steps` and `memory`.
void variance(const Reduced& reduced, double step_mm, double worth_of_sample, SpreadResult& result);

/// Takes mechanisms of noise away again that coarse steps may feign.
void distrust_beside_coarse_steps(const Reduced& reduced, SpreadResult& result);

/// Why is there no echo? Adds `dropout`, `sunlight`, or what is unknown.
void losses(const Reduced& reduced, SpreadResult& result);

/// Does the noise of weak echoes grow more steeply than a receiver's own does? So it does where they are
/// about to be lost: `dropout` brings it along, and where none has been lost yet it is `intensity-noise` or
/// `dropout`.
void may_be_near_threshold(const Reduced& reduced, SpreadResult& result);

}  // namespace fit::explain::spread
