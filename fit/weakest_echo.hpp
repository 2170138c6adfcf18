// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>

namespace fit {

/// Fewer counts are no echo: where laws of one over the intensity end.
constexpr double weakest_counts = 5;

/// Of an echo as a lidar reports it, which may be none.
[[nodiscard]] inline double counts_of_echo(double intensity) { return std::max(weakest_counts, intensity); }

}  // namespace fit
