// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "rig/runner/runner.hpp"

namespace rig {
namespace {

using nlohmann::json;

/// The entry VALUE of a result's `values` list (results.md), or null.
json value_of(const SessionStore& session, const Limit& limit) {
  const auto text = session.latest_result(limit.kind);
  if (!text) return nullptr;
  const json result = json::parse(*text, nullptr, false);
  if (!result.is_object() || !result.contains("values") || !result["values"].is_array()) return nullptr;
  for (const json& value : result["values"])
    if (value.is_object() && value.value("name", "") == limit.value) return value;
  return nullptr;
}

/// What there is instead, for a misspelt limit.
std::string names_in(const SessionStore& session, const std::string& kind) {
  const json result = json::parse(session.latest_result(kind).value_or("null"), nullptr, false);
  if (!result.is_object() || !result.contains("values") || !result["values"].is_array()) return "";
  std::string names;
  for (const json& value : result["values"])
    if (value.is_object()) names += (names.empty() ? "; there are " : ", ") + value.value("name", "");
  return names;
}

double number_or(const json& object, const char* key, double otherwise) {
  return object.contains(key) && object[key].is_number() ? object[key].get<double>() : otherwise;
}

double expanded_uncertainty(const json& value) {
  return number_or(value, "U", number_or(value, "k", 2) * number_or(value, "u", 0));
}

/// Guarded acceptance as in ILAC-G8:09/2019: w = 0 is simple acceptance, w = U accepts falsely in less
/// than 2.5 %. Between the guarded and the plain limit, and as far beyond it, nothing is decided.
std::string verdict_of(const Limit& limit, double value, double expanded, std::string& reason) {
  const double guard = limit.guarded ? expanded : limit.guard_band;
  const double low = limit.min.value_or(-INFINITY), high = limit.max.value_or(INFINITY);
  if (limit.max_expanded && !(expanded <= *limit.max_expanded)) {
    reason = "the uncertainty is larger than allowed";
    return "fail";
  }
  if (value < low - guard || value > high + guard) {
    reason = "outside the limits";
    return "fail";
  }
  if (value >= low + guard && value <= high - guard) return "pass";
  reason = "within the guard band of the limit";
  return "inconclusive";
}

json check(const Limit& limit, const SessionStore& session) {
  json result = {{"name", limit.name}};
  if (limit.min) result["min"] = *limit.min;
  if (limit.max) result["max"] = *limit.max;
  if (limit.max_expanded) result["max_U"] = *limit.max_expanded;
  const json value = value_of(session, limit);
  const double number = value.is_object() ? number_or(value, "value", NAN) : NAN;
  if (!std::isfinite(number)) {
    result["verdict"] = "inconclusive";
    result["reason"] = "no result " + limit.kind + "." + limit.value + names_in(session, limit.kind);
    return result;
  }
  const double expanded = expanded_uncertainty(value);
  std::string reason;
  result["value"] = number;
  if (std::isfinite(expanded)) result["U"] = expanded;
  result["unit"] = value.value("unit", "");
  result["verdict"] = verdict_of(limit, number, expanded, reason);
  result["reason"] = reason;
  return result;
}

}  // namespace

json check_limits(const std::vector<Limit>& limits, const SessionStore& session) {
  json checks = json::array();
  const bool guarded =
      std::ranges::any_of(limits, [](const Limit& limit) { return limit.guarded || limit.guard_band > 0; });
  for (const Limit& limit : limits) checks.push_back(check(limit, session));
  return {{"schema", "limits/1"},
          {"rule", guarded ? "guarded acceptance (ILAC-G8:09/2019) with the guard bands of the procedure"
                           : "simple acceptance (ILAC-G8:09/2019, guard band w = 0)"},
          {"checks", checks}};
}

}  // namespace rig
