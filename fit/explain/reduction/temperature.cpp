// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/temperature.hpp"

#include <algorithm>
#include <cmath>

namespace fit::explain::reduction {

std::optional<double> reference_temperature(const std::vector<CaptureInfo>& captures) {
  const auto is_read = [](const CaptureInfo& capture) { return capture.temperature_c.has_value(); };
  const auto first = std::ranges::find_if(captures, is_read);
  if (first == captures.end()) return std::nullopt;
  return std::ranges::all_of(captures, is_read) ? first->temperature_c : steady_c;
}

bool temperature_varies(const std::vector<CaptureInfo>& captures, double reference_c) {
  constexpr double steady_within_k = 0.2;
  return std::ranges::any_of(captures, [&](const CaptureInfo& capture) {
    return capture.temperature_c && std::abs(*capture.temperature_c - reference_c) > steady_within_k;
  });
}

}  // namespace fit::explain::reduction
