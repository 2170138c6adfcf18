// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/reduction/reduce.hpp"
#include "fit/explain/reduction/samples.hpp"

namespace fit::explain::reduction {

/// Where a solid thing stood before the targets in some scans: a person, a door. Neighbouring beams see it
/// side by side in one scan, nearer than they do in others, as no stray sample of theirs does. `sigma_mm`: of
/// a sample.
[[nodiscard]] std::vector<Occluder> occluders_in(const Samples& samples, const Scene& scene, double stage_rad,
                                                 double sigma_mm);

/// Where such a thing stood in all scans of a group: nearer than the bench file's uncertainties allow, though
/// most of what is seen of its target fits, and hardly anything there is farther. Otherwise the bench file is
/// wrong.
[[nodiscard]] std::vector<Occluder> standing_occluders(const Reduced& reduced);

}  // namespace fit::explain::reduction
