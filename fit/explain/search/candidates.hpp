// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/search/fitting.hpp"

namespace fit::explain::search {

/// What to try on top of a hypothesis.
struct Asked {
  const Term* but = nullptr;  ///< Not that one.
  bool named = true;          ///< Every mechanism of the catalogue that the bench does not know ...
  bool unnamed = true;        ///< ... and every unnamed function.
};

/// Whatever explains more together with `h`, looked at one by one and not fitted; the best first.
[[nodiscard]] std::vector<Candidate> candidates(Fitting& fitting, const Hypothesis& h, const Asked& asked);

}  // namespace fit::explain::search
