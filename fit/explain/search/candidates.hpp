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

/// Whether a comb may explain more together with `h`, or is part of it: then cells must not be taken together.
[[nodiscard]] bool shows_a_comb(Fitting& fitting, const Hypothesis& h);

}  // namespace fit::explain::search
