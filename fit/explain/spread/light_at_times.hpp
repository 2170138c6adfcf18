// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/spread/spans_of_time.hpp"
#include "fit/explain/spread/variance_model.hpp"

namespace fit::explain::spread {

/// More noise from one time to another, around a beam angle or at all.
struct LightAtTimes {
  PlaceAndTimes where_and_when;
  double spans = 1;      ///< Of time that were tried.
  std::size_t seen = 0;  ///< Captures within.
};

/// The one that explains most of what is left by the variances fitted so far, by its score. None where there
/// are not several times, or where nothing scatters more.
[[nodiscard]] std::optional<LightAtTimes> light_at_times(const VarianceModel& model,
                                                         const std::vector<double>& variances);

/// Whether most of what light in `column` would reach is met elsewhere, or at other times, by echoes as weak
/// or weaker.
[[nodiscard]] bool reaches_no_weaker_echoes(const std::vector<Pool>& pools, const Column& column);

}  // namespace fit::explain::spread
