// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/spread.hpp"
#include "fit/explain/spread/variance_model.hpp"

namespace fit::explain::spread {

/// Whether pools have a place on that coordinate.
[[nodiscard]] bool have_place_on(Coordinate coordinate);

/// Standard deviation of a sample along a coordinate, mm. `before`, `after`: variances of the model's pools
/// as simulated and as explained, mm^2.
[[nodiscard]] SpreadCurve scatter_along(const VarianceModel& model, Coordinate coordinate,
                                        const std::vector<double>& before, const std::vector<double>& after);

}  // namespace fit::explain::spread
