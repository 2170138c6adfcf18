// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/model/mean_result.hpp"
#include "fit/explain/model/spread.hpp"

namespace fit::explain {

/// What the searches came to.
struct Findings {
  Reduced reduced;  ///< Predicted at the best hypothesis of the means.
  SpreadResult spread;
  MeanResult means;
};

}  // namespace fit::explain
