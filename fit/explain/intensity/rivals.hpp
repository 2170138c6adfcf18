// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/explanation.hpp"
#include "fit/explain/intensity/suspicion.hpp"

/// For the next experiment: who is suspected, and what recordings are worth between suspects.
namespace fit::explain::intensity {

/// A suspicion as the next experiment takes it: another law is one whose stated coefficients are off.
[[nodiscard]] LightSuspect light_suspect(const Readings& readings, const std::vector<Suspicion>& accepted,
                                         const Suspicion& suspicion);

/// Evidence (logarithm of odds) against one (column) when another (row) is true.
[[nodiscard]] Eigen::MatrixXd evidence_between(const Readings& readings,
                                               const std::vector<LightSuspect>& suspects);

}  // namespace fit::explain::intensity
