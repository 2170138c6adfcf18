// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

/// Whether all figures of an answer are numbers; only the next experiment may be null.
inline bool is_finite(const nlohmann::json& answer) {
  if (answer.is_null()) return false;
  if (answer.is_number_float()) return std::isfinite(answer.get<double>());
  if (!answer.is_structured()) return true;
  for (const auto& [key, value] : answer.items())
    if (key != "next_experiment" && !is_finite(value)) return false;
  return true;
}
