// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/spread.hpp"
#include "fit/explain/reduce.hpp"

namespace fit::explain::spread {

/// Does the range swing at the frequency of a lamp or a supply? Adds it as unknown, and takes it off the
/// sectors: seen from scan to scan it looks like mirror faces, a swinging stage or memory.
void flicker(const Reduced& reduced, std::vector<Sector>& sectors, SpreadResult& result);

/// Takes off the cells what the same wave leaves in their means over a few scans, and adds to their
/// variances; once, however often it is asked to.
void take_off_flicker(Reduced& reduced);

/// Whether it does, by that answer.
[[nodiscard]] bool flickers(const SpreadResult& result);

}  // namespace fit::explain::spread
