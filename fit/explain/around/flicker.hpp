// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <vector>

#include "fit/explain/model/mean_model.hpp"
#include "fit/explain/model/spread.hpp"

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
