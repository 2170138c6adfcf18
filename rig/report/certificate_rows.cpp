// SPDX-License-Identifier: MIT
#include "rig/report/certificate_rows.hpp"

#include <nlohmann/json.hpp>

namespace rig {

using nlohmann::json;

json json_or_empty(const std::optional<std::string>& text) {
  if (!text) return json::object();
  json value = json::parse(*text, nullptr, false, true);
  return value.is_discarded() ? json::object() : value;
}

void add_row(json& rows, const std::string& name, const std::string& text) {
  rows.push_back({{"name", name}, {"text", text.empty() ? "not stated" : text}});
}

}  // namespace rig
