// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <vector>

#include "fit/explain/hypothesis.hpp"

namespace fit::explain {

/// One other explanation of what a term explains, and how much worse it is.
struct Rival {
  std::optional<Term> term;  ///< Empty: an unnamed function, or nothing at all.
  std::optional<Shape> shape;
  double behind = 0;  ///< Log of the evidence ratio, >= 0 when it is worse.
  bool fits_as_well =
      false;  ///< Worse only because it has more to adjust: the recording itself does not tell them apart.
};

struct HeldOutFigures {
  double log_likelihood = 0, rms_mm = 0, coverage = 0, cells = 0;
};

struct MeanResult {
  explicit MeanResult(const Bench& bench) : best(bench) {}
  Hypothesis best;
  std::vector<std::vector<Rival>> rivals;  ///< For every term of `best`, the closest first.
  std::vector<double> probability;         ///< Of every term of `best`.
  std::vector<HeldOutFigures> without;  ///< Held-out figures without each term.
  HeldOutFigures before, after;
  double noise_floor_mm = 0;
  double scatter_mm = 0;   ///< Of whole captures, beyond what their samples say; 0: none.
  double excess = 1;       ///< Factor on the variance of the means.
  bool transfers = true;   ///< False: something was dropped because other places do not confirm it.
  bool cut_short = false;  ///< Not everything was tried that might explain more.
  MeanNoise noise;
};

/// Finds the mechanisms that move means. `reduced` is left predicted at the best hypothesis.
[[nodiscard]] MeanResult search_means(Reduced& reduced, const MeanNoise& noise, const Progress& progress);

}  // namespace fit::explain
