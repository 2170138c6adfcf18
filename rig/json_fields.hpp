// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

namespace rig {

// Members of documents that others wrote: what is missing, empty or of another kind is not there.

inline std::string text_of(const nlohmann::json& object, const char* key, const std::string& otherwise = "") {
  if (!object.is_object() || !object.contains(key)) return otherwise;
  const nlohmann::json& value = object.at(key);
  if (value.is_string())
    return value.get_ref<const std::string&>().empty() ? otherwise : value.get<std::string>();
  return value.is_null() ? otherwise : value.dump();
}

inline double number_of(const nlohmann::json& object, const char* key, double otherwise = std::nan("")) {
  if (!object.is_object() || !object.contains(key) || !object.at(key).is_number()) return otherwise;
  return object.at(key).get<double>();
}

/// The expanded uncertainty of a value of a result (docs/reference/result.md), from its `U` or its `u` and
/// `k`.
inline double expanded_of(const nlohmann::json& value, double otherwise = std::nan("")) {
  const double u = number_of(value, "u");
  return number_of(value, "U", std::isnan(u) ? otherwise : number_of(value, "k", 2) * u);
}

inline nlohmann::json list_of(const nlohmann::json& object, const char* key) {
  return object.is_object() && object.contains(key) && object.at(key).is_array() ? object.at(key)
                                                                                 : nlohmann::json::array();
}

/// Whether what an explanation (`explanation/1`) does not know is a target that is not where the bench file
/// has it.
inline bool is_bench_error(const nlohmann::json& explanation) {
  return explanation.is_object() && explanation.contains("unknown") &&
         text_of(explanation["unknown"], "bench_error") == "true";
}

}  // namespace rig
