// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/explanation.hpp"

namespace fit::explain {

/// Explains the intensity, if the bench makes a claim about it (`radiometry` among its known mechanisms), and
/// adds what it found to the explanation: mechanisms, sets, unknown physics, places, pictures, and the
/// bench's new law. `reduced` is predicted where things stand. A bench without such a claim leaves everything
/// as it is.
void explain_intensity(const Reduced& reduced, Explanation& explanation);

/// Smallest evidence (logarithm of odds) by which recordings like these tell one suspect of intensity from
/// another, whichever is true; what a bench's law leaves open is taken into account.
[[nodiscard]] double separation_of_light(const Reduced& reduced, const std::vector<LightSuspect>& suspects);

}  // namespace fit::explain
