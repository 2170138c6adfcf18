// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <vector>

#include "fit/recording.hpp"

namespace fit::explain::reduction {

/// A thermometer that shows no more than that shows nothing.
constexpr double steady_within_k = 0.2;

/// The first temperature that anybody read, deg C.
[[nodiscard]] std::optional<double> first_temperature(const std::vector<CaptureInfo>& captures);

}  // namespace fit::explain::reduction
