// SPDX-License-Identifier: MIT
#pragma once

#include <set>
#include <vector>

#include "fit/explain/spread.hpp"
#include "fit/explain/spread/variance_model.hpp"

namespace fit::explain::spread {

/// What the scatter of samples is drawn along: the coordinates of what was found about it, as far as pools
/// have a place on them.
[[nodiscard]] std::set<Coordinate> coordinates_of_noise(const SpreadResult& result);

/// Takes pictures of noise and of memory away that show nothing which is found any more.
void drop_curves_of_nothing(SpreadResult& result);

/// Standard deviation of a sample along a coordinate, mm. `before`, `after`: variances of the model's pools
/// as simulated and as explained, mm^2.
[[nodiscard]] SpreadCurve scatter_along(const VarianceModel& model, Coordinate coordinate,
                                        const std::vector<double>& before, const std::vector<double>& after);

}  // namespace fit::explain::spread
