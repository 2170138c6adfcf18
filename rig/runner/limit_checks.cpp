// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/runner/runner.hpp"
#include "rig/session/standing.hpp"

namespace rig {
namespace {

using nlohmann::json;

/// The newest result of the limit's kind; null if there is none.
json result_of(const SessionStore& session, const Limit& limit) {
  return json::parse(session.latest_result(limit.kind).value_or("null"), nullptr, false);
}

/// The entry VALUE of a result's `values` list (results.md), or null.
json value_of(const json& result, const Limit& limit) {
  for (const json& value : list_of(result, "values"))
    if (value.is_object() && value.value("name", "") == limit.value) return value;
  return nullptr;
}

/// What there is instead, for a misspelt limit.
std::string names_in(const json& result) {
  std::string names;
  for (const json& value : list_of(result, "values"))
    if (value.is_object()) names += (names.empty() ? "; there are " : ", ") + value.value("name", "");
  return names;
}

struct Judgement {
  std::string verdict, reason;  ///< The reason, with figures, is empty when the limit is met.
};

/// Guarded acceptance as in ILAC-G8:09/2019: w = 0 is simple acceptance, w = U accepts falsely in less
/// than 2.5 %. Between the guarded and the plain limit, and as far beyond it, nothing is decided.
Judgement judge(const Limit& limit, double value, double expanded, const std::string& unit) {
  const double guard = limit.guarded ? expanded : limit.guard_band;
  const double low = limit.min.value_or(-INFINITY), high = limit.max.value_or(INFINITY);
  if (limit.max_expanded && !std::isfinite(expanded))
    return {"fail", "its uncertainty is not known, and at most " +
                        fit::with_unit(to_text(*limit.max_expanded), unit) + " is allowed"};
  if (limit.max_expanded && expanded > *limit.max_expanded)
    return {"fail", "its uncertainty is larger than the " +
                        fit::with_unit(to_text(*limit.max_expanded), unit) + " allowed"};
  if (limit.guarded && !std::isfinite(expanded))
    return {"inconclusive", "its uncertainty is not known, and so its guard band is not"};
  const bool too_low = value - low < high - value;  // Or nearer to that side.
  const double beyond = too_low ? low - value : value - high;
  const std::string side = too_low ? "below the smallest value allowed" : "above the largest value allowed";
  if (beyond > guard) return {"fail", fit::with_unit(fit::format_value(beyond, expanded), unit) + " " + side};
  if (beyond <= -guard) return {"pass", ""};
  const std::string inner = too_low ? "above the smallest value allowed" : "below the largest value allowed";
  return {"inconclusive", fit::with_unit(fit::format_value(std::abs(beyond), expanded), unit) + " " +
                              (beyond > 0 ? side : inner) + ", within the guard band of " +
                              fit::with_unit(fit::format_value(guard, expanded), unit)};
}

/// "9.00 ± 0.20 mm; allowed: 1 to 5 mm, U at most 0.5 mm".
std::string figures(const Limit& limit, double value, double expanded, const std::string& unit) {
  std::string allowed;
  if (limit.min && limit.max)
    allowed = to_text(*limit.min) + " to " + fit::with_unit(to_text(*limit.max), unit);
  else if (limit.min || limit.max)
    allowed = (limit.min ? "at least " : "at most ") +
              fit::with_unit(to_text(limit.min ? *limit.min : *limit.max), unit);
  if (limit.max_expanded)
    allowed += (allowed.empty() ? "U at most " : ", U at most ") +
               fit::with_unit(to_text(*limit.max_expanded), unit);
  return fit::format_measurement(value, expanded, unit) + "; allowed: " + allowed;
}

json check(const Limit& limit, const SessionStore& session) {
  json result = {{"name", limit.name}, {"of", limit.kind + "." + limit.value}};
  if (limit.min) result["min"] = *limit.min;
  if (limit.max) result["max"] = *limit.max;
  if (limit.max_expanded) result["max_U"] = *limit.max_expanded;
  const json found = result_of(session, limit), value = value_of(found, limit);
  const double number = number_of(value, "value");
  if (!std::isfinite(number)) {
    result["verdict"] = "inconclusive";
    result["reason"] = "no result " + limit.kind + "." + limit.value + names_in(found);
    result["text"] = result["reason"];
    return result;
  }
  const double expanded = expanded_of(value);
  const std::string unit = value.contains("unit") && value["unit"].is_string() ? value["unit"] : json("");
  auto [verdict, reason] = judge(limit, number, expanded, unit);
  if (const std::vector<std::string> doubts = doubts_of(found); verdict == "pass" && !doubts.empty()) {
    verdict = "inconclusive";
    reason = "the result is in doubt: " + doubts.front();
  }
  result["value"] = number;
  if (std::isfinite(expanded)) result["U"] = expanded;
  result["unit"] = unit;
  result["verdict"] = verdict;
  result["reason"] = reason;
  result["text"] = figures(limit, number, expanded, unit) + (reason.empty() ? "" : "; " + reason);
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

bool all_pass(const json& checks) {
  return std::ranges::all_of(checks, [](const json& each) { return each.value("verdict", "") == "pass"; });
}

}  // namespace rig
