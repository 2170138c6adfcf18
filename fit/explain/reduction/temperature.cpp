// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/temperature.hpp"

#include <algorithm>

namespace fit::explain::reduction {

std::optional<double> reference_temperature(const std::vector<CaptureInfo>& captures) {
  const auto is_read = [](const CaptureInfo& capture) { return capture.temperature_c.has_value(); };
  const auto first = std::ranges::find_if(captures, is_read);
  if (first == captures.end()) return std::nullopt;
  return std::ranges::all_of(captures, is_read) ? first->temperature_c : steady_c;
}

}  // namespace fit::explain::reduction
