// SPDX-License-Identifier: MIT
#include "fit/bench/placed_anew.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace fit {

bool is_placed_anew(const Bench& bench, const std::string& target) {
  const auto& document = bench.document.json();
  if (!document.contains("targets") || !document["targets"].is_array()) return false;
  return std::ranges::any_of(document["targets"], [&](const nlohmann::json& entry) {
    return entry.is_object() && entry.value("name", "") == target && entry.value("placed_anew", false);
  });
}

}  // namespace fit
