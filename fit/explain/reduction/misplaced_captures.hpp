// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain::reduction {

/// A capture whose ranges fit the bench file, but not from where it says that stage or target stood.
struct MisplacedCapture {
  int capture = 0;
  double stage_rad = 0, target_shift_mm = 0;  ///< Where it fits.
};

/// The captures that do not fit the bench file as they are stated, though most others do and they fit at
/// another stage angle, or with the target at another of the recorded distances: exchanged, or mistyped.
/// `recordings`: of which the captures were reduced, in that order.
[[nodiscard]] std::vector<MisplacedCapture> misplaced_captures(
    const Reduced& reduced, const std::vector<const Recording*>& recordings);

}  // namespace fit::explain::reduction
