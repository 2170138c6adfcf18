// SPDX-License-Identifier: MIT
#include "lidar/scan_kernels.hpp"

namespace lidar {

std::size_t find_empty_line(std::string_view text) {
  const std::size_t found = text.find("\n\n");
  return found == std::string_view::npos ? text.size() : found;
}

}  // namespace lidar
