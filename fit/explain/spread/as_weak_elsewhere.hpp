// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

namespace fit::explain::spread {

/// Echoes of one strength, and how much of what was found hangs on them.
struct Echoes {
  double intensity = 0;  ///< Counts; NaN when nobody knows.
  double weight = 0;
};

/// Whether echoes as weak as most of these, or weaker, are met elsewhere, or at other times, without what was
/// found. Otherwise nobody can say that it is not what befalls so weak echoes.
[[nodiscard]] bool is_as_weak_elsewhere(const std::vector<Echoes>& found_on,
                                        const std::vector<double>& intensities_elsewhere);

}  // namespace fit::explain::spread
