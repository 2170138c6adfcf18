// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

namespace rig {

// Members of documents that others wrote: what is missing or of another kind is not there.

inline std::string text_of(const nlohmann::json& object, const char* key, const std::string& otherwise = "") {
  if (!object.is_object() || !object.contains(key)) return otherwise;
  const nlohmann::json& value = object.at(key);
  if (value.is_string()) return value.get<std::string>();
  return value.is_null() ? otherwise : value.dump();
}

inline double number_of(const nlohmann::json& object, const char* key, double otherwise = std::nan("")) {
  if (!object.is_object() || !object.contains(key) || !object.at(key).is_number()) return otherwise;
  return object.at(key).get<double>();
}

inline nlohmann::json list_of(const nlohmann::json& object, const char* key) {
  return object.is_object() && object.contains(key) && object.at(key).is_array() ? object.at(key)
                                                                                 : nlohmann::json::array();
}

}  // namespace rig
