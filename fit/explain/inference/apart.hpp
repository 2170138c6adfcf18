// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fit/explain/model/results.hpp"
#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::inference {

/// What a recording is worth between suspects that act beside the means, nats: the log-likelihood that is
/// expected to be lost when one (row) is true as it came out, and another (column) takes up what it can. The
/// last of them may be that nothing is missing, which takes up nothing.
[[nodiscard]] Eigen::MatrixXd evidence_between(const Reduced& reduced, const std::vector<Suspect>& suspects,
                                               bool may_be_nothing = false);

}  // namespace fit::explain::inference
