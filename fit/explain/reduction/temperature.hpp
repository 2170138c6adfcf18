// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <optional>
#include <vector>

#include "fit/recording.hpp"

namespace fit::explain {

/// At which a lidar's housing is held, and taken to be where nobody read it, deg C.
constexpr double steady_c = 25;
/// Standard uncertainty of the latter: rooms and what lidars warm themselves by differ so much.
constexpr double u_unread_k = 10;

}  // namespace fit::explain

namespace fit::explain::reduction {

/// From which temperatures count, deg C: the first that anybody read; where nobody did in some of the
/// captures, that of a housing that is not heated. Empty without any thermometer.
[[nodiscard]] inline std::optional<double> reference_temperature(const std::vector<CaptureInfo>& captures) {
  const auto is_read = [](const CaptureInfo& capture) { return capture.temperature_c.has_value(); };
  const auto first = std::ranges::find_if(captures, is_read);
  if (first == captures.end()) return std::nullopt;
  return std::ranges::all_of(captures, is_read) ? first->temperature_c : steady_c;
}

}  // namespace fit::explain::reduction
