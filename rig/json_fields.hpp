// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
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

/// Whether one of the answers that an explanation leaves open is that nothing is missing.
inline bool may_be_nothing(const nlohmann::json& explanation) {
  const nlohmann::json sets = list_of(explanation, "undecided_between");
  return std::ranges::any_of(sets, [](const nlohmann::json& set) {
    return std::ranges::find(set, nlohmann::json("nothing-missing")) != set.end();
  });
}

/// The verdict of an explanation as a sentence.
inline std::string verdict_in_words(const nlohmann::json& explanation) {
  const std::string verdict = text_of(explanation, "verdict");
  if (verdict == "nothing-missing")
    return "Nothing is missing: the simulation explains the recording to within its noise.";
  if (verdict == "explained") return "The mismatch is explained.";
  if (verdict == "undecided")
    return may_be_nothing(explanation) && list_of(explanation, "mechanisms").empty()
               ? "This recording does not decide whether something is missing."
               : "Something is missing, and this recording does not decide which of several causes it is.";
  if (is_bench_error(explanation)) return "The bench file and the recording do not agree.";
  if (verdict == "unknown-physics") return "Something is missing that no mechanism of the catalogue makes.";
  return verdict;
}

}  // namespace rig
