// SPDX-License-Identifier: MIT
#pragma once

/// Mechanisms that rooms beside the model ask for, as the catalogue calls them.
namespace fit::explain::spread::ids {

inline constexpr const char* angle_jitter = "angle-jitter";
inline constexpr const char* mixed_pixel = "mixed-pixel";
inline constexpr const char* outliers = "outliers";
inline constexpr const char* rounding = "rounding";

}  // namespace fit::explain::spread::ids
