// SPDX-License-Identifier: MIT
#pragma once

#include "fit/explain/explanation.hpp"
#include "fit/explain/intensity/judgement.hpp"

/// Where on its coordinates the intensity deviates.
namespace fit::explain::intensity {

/// Where something accepted carries at least a quarter of its largest information; `law`: the fitted one.
[[nodiscard]] std::vector<Located> locate(const Readings& readings, const std::vector<Suspicion>& accepted,
                                          const Suspicion& suspicion, const IntensityLaw& law);

/// Mean deviations along beam, range and incidence, before and after everything accepted (`after`).
[[nodiscard]] std::vector<IntensityCurve> curves_of(const Readings& readings, const Model& after);

/// What was found and has no name, for the twin: functions of one coordinate as they are, and of suspects
/// that nobody can choose from, the best one's effect along its coordinate.
void add_tables(const Readings& readings, const Judgement& judgement, Bench& bench);

}  // namespace fit::explain::intensity
