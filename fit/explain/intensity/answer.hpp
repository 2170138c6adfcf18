// SPDX-License-Identifier: MIT
#pragma once

#include <array>

#include "fit/explain/explanation.hpp"
#include "fit/explain/intensity/judgement.hpp"

namespace fit::explain::intensity {

/// The law as the recording has it, with everything accepted at work.
struct FittedLaw {
  IntensityLaw law;
  std::array<double, IntensityLaw::size> u{};  ///< Standard; 0 of what was not fitted.
  IntensityLaw expanded_at;                    ///< The law around which the model is linear: nearly that.
  Model model;                                 ///< The deviations from it.
};
[[nodiscard]] FittedLaw fitted_law(const Readings& readings, const std::vector<Suspicion>& accepted);

/// Adds what was found: mechanisms in words, sets that cannot be told apart, what has no name, and where.
void tell_findings(const Readings& readings, const Judgement& judgement, const FittedLaw& fitted,
                   Explanation& out);

/// How well intensities agree with the law before and after.
void add_notes(const Readings& readings, const Judgement& judgement, Explanation& out);

}  // namespace fit::explain::intensity
