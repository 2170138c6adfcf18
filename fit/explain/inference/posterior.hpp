// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "fit/explain/inference/search.hpp"

namespace fit::explain::inference {

/// A mechanism that is named, or a set of which one is.
struct Named {
  Term term;  ///< Without a kind: nothing at all.
  double probability = 0;
};
struct Undecided {
  std::vector<Named> members;          ///< The most probable first; together they hold 0.95.
  std::vector<std::string> also = {};  ///< What the bench file may have wrong instead.
};

struct Likely {
  Hypothesis hypothesis;
  double probability = 0;
};

struct Posterior {
  std::vector<Named> named;
  std::vector<Undecided> undecided;
  std::vector<Named> forms;    ///< What the catalogue does not know.
  std::vector<Likely> likely;  ///< The most probable first; together they hold 0.95.
};

/// What the visited hypotheses come to.
[[nodiscard]] Posterior posterior_of(const Explored& explored);

}  // namespace fit::explain::inference
