// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/spread/scans.hpp"

/// What else makes scans differ from each other: logarithms of Bayes factors, for whoever suspects something
/// else.
namespace fit::explain::spread {

/// Of a stage that swings after moves.
[[nodiscard]] double evidence_of_swing(const std::vector<Group>& groups, std::vector<Sector>& sectors);
/// Of beams whose noise remembers earlier scans.
[[nodiscard]] double evidence_of_memory(const std::vector<Group>& groups);
/// Of a range and an angle that every scan has at random.
[[nodiscard]] double evidence_of_common_noise(const std::vector<Scan>& scans);

}  // namespace fit::explain::spread
