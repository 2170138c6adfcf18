// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/spread/scan_classes.hpp"

namespace fit::explain::spread {

/// The best pattern of scans' numbers that grows, within captures or from one to the next. `price`: log of
/// what it costs to have looked for a pattern at all.
[[nodiscard]] Pattern growing_pattern(const std::vector<Scan>& scans, double price);

}  // namespace fit::explain::spread
