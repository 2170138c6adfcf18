// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

/// Where an answer has a figure that is no number; empty if all are. Only the next experiment may be null.
inline std::string not_finite(const nlohmann::json& answer) {
  if (answer.is_null()) return "/null";
  if (answer.is_number_float()) return std::isfinite(answer.get<double>()) ? "" : "/nan";
  if (!answer.is_structured()) return "";
  for (const auto& [key, value] : answer.items()) {
    if (key == "next_experiment") continue;
    if (const std::string place = not_finite(value); !place.empty()) return "/" + key + place;
  }
  return "";
}
