// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <string_view>

namespace lidar {

/// Where the first LF LF begins; the text's size when there is none.
[[nodiscard]] std::size_t find_empty_line(std::string_view text);

}  // namespace lidar
