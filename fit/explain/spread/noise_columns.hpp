// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <vector>

#include "fit/explain/spread.hpp"
#include "fit/explain/spread/variance_model.hpp"

/// What the variance of samples may depend on: a column each, for pools of the same noise of size one.
namespace fit::explain::spread {

/// Of one over the intensity, by which the variance of weak echoes may grow. Those beyond a receiver's own
/// noise (`steepest_of_noise`) are of echoes that are about to be lost.
inline constexpr std::array exponents_of_noise{1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.5, 8.0, 12.0, 18.0};

[[nodiscard]] Column of_intensity(const std::vector<Pool>& pools, double exponent);
/// Light that falls in around one beam angle; the higher the power, the sharper its ends.
[[nodiscard]] Column of_light(const std::vector<Pool>& pools, double centre_deg, double width_deg,
                              double power = 2);
/// The same where it only falls in between two times; elsewhere none.
[[nodiscard]] Column between_times(const std::vector<Pool>& pools, Column column, Interval times_s);
/// Angles that scatter.
[[nodiscard]] Column of_lever(const std::vector<Pool>& pools);
/// Whether it is one of those that follow: noise of single samples, whose size has a unit of length or angle.
[[nodiscard]] bool makes_noise(const Suspect& suspect);
/// Of `intensity-noise`, `sunlight`, `angle-jitter` or `range-noise`, where its parameters have it; throws
/// std::logic_error for any other.
[[nodiscard]] Column of_suspect(const std::vector<Pool>& pools, const Suspect& suspect);
/// Its size there, mm^2 (angle-jitter: rad^2).
[[nodiscard]] double size_of(const Suspect& suspect);

}  // namespace fit::explain::spread
