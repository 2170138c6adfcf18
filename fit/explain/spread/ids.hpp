// SPDX-License-Identifier: MIT
#pragma once

/// The mechanisms that the questions about the spread ask for, as the catalogue calls them; `constant_noise`
/// beside them.
namespace fit::explain::spread::ids {

inline constexpr const char* angle_jitter = "angle-jitter";
inline constexpr const char* correlated_noise = "correlated-noise";
inline constexpr const char* dropout = "dropout";
inline constexpr const char* facet_wobble = "facet-wobble";
inline constexpr const char* intensity_noise = "intensity-noise";
inline constexpr const char* mixed_pixel = "mixed-pixel";
inline constexpr const char* outliers = "outliers";
inline constexpr const char* rounding = "rounding";
inline constexpr const char* settling = "settling";
inline constexpr const char* sunlight = "sunlight";

}  // namespace fit::explain::spread::ids
