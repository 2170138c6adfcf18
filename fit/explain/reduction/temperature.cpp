// SPDX-License-Identifier: MIT
#include "fit/explain/reduction/temperature.hpp"

namespace fit::explain::reduction {

std::optional<double> first_temperature(const std::vector<CaptureInfo>& captures) {
  for (const CaptureInfo& capture : captures)
    if (capture.temperature_c) return capture.temperature_c;
  return std::nullopt;
}

}  // namespace fit::explain::reduction
