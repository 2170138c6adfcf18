// SPDX-License-Identifier: MIT
#pragma once

#include <optional>

#include "fit/explain/spread/variance_model.hpp"

namespace fit::explain::spread {

/// More noise from one time to another, around a beam angle or at all.
struct LightAtTimes {
  bool at_all_angles = false;
  double centre_deg = 0, width_deg = 0;
  Interval times_s = {};
  double u_from_s = 0, u_to_s = 0;  ///< Of these times.
  double places = 1;                ///< Spans of time that were tried.
  std::size_t seen = 0;             ///< Captures within.
};

/// The one that explains most of what is left by the variances fitted so far, by its score. None where there
/// are not several times, or where nothing scatters more.
[[nodiscard]] std::optional<LightAtTimes> light_at_times(const VarianceModel& model,
                                                         const std::vector<double>& variances);

/// Whether most of what light in `column` would reach is met elsewhere, or at other times, by echoes as weak
/// or weaker. Otherwise nobody can say that it is not the noise of so weak echoes.
[[nodiscard]] bool is_as_weak_elsewhere(const std::vector<Pool>& pools, const Column& column);

}  // namespace fit::explain::spread
