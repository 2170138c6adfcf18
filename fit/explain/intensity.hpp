// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/explanation.hpp"

namespace fit::explain {

/// Explains the intensity, if the bench makes a claim about it (`radiometry` among its known mechanisms), and
/// adds what it found to the explanation: mechanisms, sets, unknown physics, places, pictures, and the
/// bench's new law. `reduced` is predicted where things stand. A bench without such a claim leaves everything
/// as it is.
void explain_intensity(const Reduced& reduced, Explanation& explanation);

/// Evidence (logarithm of odds) that recordings like these give against one suspect of intensity (column)
/// when another (row) is true; what a bench's law leaves open is taken into account.
[[nodiscard]] Eigen::MatrixXd evidence_between(const Reduced& reduced,
                                               const std::vector<LightSuspect>& suspects);

}  // namespace fit::explain
