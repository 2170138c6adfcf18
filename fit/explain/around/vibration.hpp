// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/model/spread.hpp"
#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain {

/// Does the angle of the stage, or the range, swing at one frequency from scan to scan, with a phase of its
/// own in every capture? Adds it as unknown. The frequency, Hz.
[[nodiscard]] std::optional<double> vibration(const Reduced& reduced, std::vector<Unexplained>& unknown);

}  // namespace fit::explain
