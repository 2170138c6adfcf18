// SPDX-License-Identifier: MIT
#pragma once

#include <span>

#include "fit/numeric/curve_point.hpp"

namespace fit {

/// Standard deviation of what points of a curve scatter beyond their own uncertainties (placement of targets,
/// say), in the unit of y; 0 where none shows, and of fewer than seven points. No family of curves is
/// assumed: every point is compared with the polynomial through its neighbours, up to three on either side
/// (Gasser, Sroka and Jennen-Steinmetz 1986, who take one; with one, the bend of a curve passes for scatter).
[[nodiscard]] double extra_scatter(std::span<const CurvePoint> points);

}  // namespace fit
