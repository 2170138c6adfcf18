// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/search/fitting.hpp"

namespace fit::explain::search {

/// Drops what the recordings of other places do not confirm, the least confirmed first. Returns whether
/// everything was confirmed.
bool keep_what_transfers(Fitting& fitting, Hypothesis& best);

}  // namespace fit::explain::search
