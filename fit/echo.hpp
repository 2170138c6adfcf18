// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

namespace fit {

/// From here on a range in millimetres is a lidar's code for why it has none. 0 is no echo.
inline constexpr std::uint16_t first_error_code_mm = 65500;

}  // namespace fit
