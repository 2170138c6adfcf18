// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fit/explain/spread.hpp"

namespace fit::explain::spread {

/// What recordings are worth between suspects of noise and of lost echoes, nats: the log-likelihood that is
/// expected to be lost when one (row) is true and another (column), whatever its size, is believed.
[[nodiscard]] Eigen::MatrixXd evidence_between(const Reduced& reduced, const std::vector<Suspect>& suspects);

}  // namespace fit::explain::spread
