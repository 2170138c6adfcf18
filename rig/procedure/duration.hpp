// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include "rig/procedure/procedure_plan.hpp"

namespace rig {

/// A duration with its unit: "1:02:03 h" or "2:03 min".
inline std::string duration_with_unit(double seconds) {
  const std::string text = duration_text(seconds);
  return text + (text.find(':') == text.rfind(':') ? " min" : " h");
}

}  // namespace rig
