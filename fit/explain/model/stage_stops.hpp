// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/reduction/reduce.hpp"

namespace fit::explain {

class MeanModel;

/// Groups one after the other for which the stage stood at one place, or turned in one capture: its error is
/// drawn once for all, but for what captures show to be drawn for each.
struct Stop {
  std::size_t first_group = 0, last_group = 0;  ///< The last one is beyond.
};
/// Whether the stage stood still from the group before to that one.
[[nodiscard]] bool stands_still(const Reduced& reduced, std::size_t group);
/// Those of a session; none where the stage never moved, as its error is then the mount's.
[[nodiscard]] std::vector<Stop> stops_of(const Reduced& reduced);

/// Variance (rad^2) of what the stage is off by at every stop, as a session shows it: from nothing to what
/// the bench file states for its resolution and its position, uniform before anything is seen. Only how a
/// stop lies off the line through its neighbours tells, in time and along the stage: what changes smoothly
/// with either is no matter of single stops, and may make the bends along the other larger.
[[nodiscard]] double variance_of_stops_rad2(const Reduced& reduced, const MeanModel& model);
/// The same of every capture at one stop, as a stage that is held by its motor draws it: by how captures
/// differ from the one before.
[[nodiscard]] double variance_within_stops_rad2(const Reduced& reduced, const MeanModel& model);

}  // namespace fit::explain
