// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "lidar/reply.hpp"

namespace lidar {

/// Who answered: VV, PP and II as they came, and the numbers needed to use them.
struct Identity {
  KeyValues version, parameters, information;
  std::string model, firmware, serial;
  int min_step = 0, max_step = 1080, front_step = 540;
  int steps_per_turn = 1440;
  double scan_period_s = 0.025;
  int min_range_mm = 20, max_range_mm = 30000;
  std::string json;  ///< Everything above as one JSON object: the session's 'lidar' entry.
};

/// From the bodies of the answers to VV, PP and II. The error says which one cannot be read and why.
[[nodiscard]] tl::expected<Identity, std::string> make_identity(std::string_view version,
                                                                std::string_view parameters,
                                                                std::string_view information);

}  // namespace lidar
