// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/intensity/suspicion.hpp"

namespace fit::explain::intensity {

/// Raises the rows' uncertainties by what neighbouring cells share and no law tells: by how much more groups
/// of them scatter than they should, around the most flexible description there is.
void weigh(Readings& readings);

/// Everything that could be added to what is accepted already, the most evident first.
[[nodiscard]] std::vector<Suspicion> suspects(const Readings& readings,
                                              const std::vector<Suspicion>& accepted);

/// Adds suspects as long as the evidence grows.
[[nodiscard]] std::vector<Suspicion> search(const Readings& readings);

/// Fits the values of everything accepted, together.
void settle(const Readings& readings, std::vector<Suspicion>& accepted);

}  // namespace fit::explain::intensity
