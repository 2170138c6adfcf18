// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/reduction/reduce.hpp"
#include "fit/explain/reduction/samples.hpp"

namespace fit::explain::reduction {

/// Of a cell of that group. Where enough samples tell, a noisy beam counts less: else its noise looks like
/// the whole scan's.
[[nodiscard]] double weight_in_scan(const Reduced& reduced, const Group& group, std::size_t cell);

/// Whether a cell's samples say what their scans have in common.
[[nodiscard]] bool is_informative(const Cell& cell);

/// What all beams of a scan have in common, as sectors of the session, and how noise is
/// autocorrelated, in the group, which is the session's next. `cell_of_beam`: index of the cell that is in
/// that column, -1 where there is none.
void summarise_scans(const Samples& samples, const std::vector<int>& cell_of_beam, Group& group,
                   Reduced& session);

}  // namespace fit::explain::reduction
