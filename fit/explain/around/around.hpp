// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <vector>

#include "fit/explain/model/results.hpp"

/// What has no rows in the model (docs/method/around-the-model.md).
namespace fit::explain {

/// Do ranges come in coarse steps? Then `rounding`; and the session knows what such steps do to means and
/// variances.
[[nodiscard]] std::optional<Suspect> find_coarse_steps(Reduced& reduced);

/// Does the angle of the stage, or the range, swing at one frequency from scan to scan, with a phase of its
/// own in every capture? Adds it as unknown. The frequency, Hz.
[[nodiscard]] std::optional<double> vibration(const Reduced& reduced, std::vector<Unexplained>& unknown);

}  // namespace fit::explain

namespace fit::explain::mains {

/// Does the range swing at the frequency of a lamp or a supply, beside what is known to happen from scan to
/// scan? Adds it as unknown. The frequency, Hz.
[[nodiscard]] std::optional<double> flicker(const Reduced& reduced, const MeanNoise& noise,
                                            const std::vector<Active>& from_scan_to_scan,
                                            std::vector<Unexplained>& unknown);

/// Takes such a wave off the sectors, off the cells' means over a few scans, and off their variances: seen
/// from scan to scan it looks like mirror faces, a swinging stage or memory.
void take_off_flicker(double hz, Reduced& reduced);

}  // namespace fit::explain::mains
