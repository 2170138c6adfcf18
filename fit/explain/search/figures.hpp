// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/mean_search.hpp"
#include "fit/explain/search/fitting.hpp"

namespace fit::explain::search {

/// Every row of the means belongs to one of them, and is predicted by the others.
struct Blocks {
  std::vector<int> of_row;
  int count = 0;
};

/// Blocks of the held-out figures at the present prediction; the result gets the noise floor there.
[[nodiscard]] Blocks blocks_and_floor(const Fitting& fitting, MeanResult& result);

[[nodiscard]] HeldOutFigures held_out(Fitting& fitting, const Hypothesis& h, const Blocks& blocks);

/// Those of mount and walls alone.
[[nodiscard]] HeldOutFigures held_out_of_nothing(Fitting& fitting, const Blocks& blocks);

/// The figures of what was judged, from all cells.
void measure(Fitting& fitting, const Hypothesis& best, MeanResult& result);

}  // namespace fit::explain::search
