// SPDX-License-Identifier: MIT
#include "rig/fitting/result_document.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/numeric/number_format.hpp"

namespace rig {

using nlohmann::json;

json new_result(const std::string& kind, const std::string& method) {
  return {{"schema", "result/1"},
          {"kind", kind},
          {"method", method},
          {"values", json::array()},
          {"budget", json::array()},
          {"tables", json::array()},
          {"plots", json::array()},
          {"notes", json::array()},
          {"undetermined", json::array()}};
}

json column(const std::string& name, const std::string& unit) { return {{"name", name}, {"unit", unit}}; }

json number_or_null(double value) {
  if (!std::isfinite(value)) return nullptr;
  return value == 0 ? 0.0 : value;  // no "-0"
}

json numbers(const std::vector<double>& values) {
  json out = json::array();
  for (const double value : values) out.push_back(number_or_null(value));
  return out;
}

json result_value(const std::string& name, const std::string& label, const fit::Estimate& estimate,
                  const std::string& unit, double freedom) {
  const double k = freedom > 0 ? fit::coverage_factor(freedom) : 2;
  json out = {{"name", name},
              {"label", label},
              {"value", number_or_null(estimate.value)},
              {"u", number_or_null(estimate.u)},
              {"unit", unit},
              {"k", k},
              {"U", number_or_null(k * estimate.u)}};
  if (freedom > 0) out["nu_eff"] = freedom;
  return out;
}

json plain_value(const std::string& name, const std::string& label, double value, const std::string& unit) {
  return {{"name", name}, {"label", label}, {"value", number_or_null(value)}, {"u", nullptr}, {"unit", unit}};
}

json budget_line(const std::string& source, const std::string& type, double u, const std::string& unit) {
  return {{"source", source}, {"kind", type}, {"u", number_or_null(u)}, {"unit", unit}};
}

double u_of_resolution(double resolution) { return resolution / std::sqrt(12.0); }

json new_plot(const std::string& title, const std::string& x_label, const std::string& y_label) {
  return {{"title", title}, {"x_label", x_label}, {"y_label", y_label}, {"series", json::array()}};
}

void add_series(json& plot, const std::string& name, const std::string& style, const std::vector<double>& x,
                const std::vector<double>& y, const std::vector<double>& u) {
  json series = {{"name", name}, {"style", style}, {"x", numbers(x)}, {"y", numbers(y)}};
  if (!u.empty()) series["u"] = numbers(u);
  plot["series"].push_back(std::move(series));
}

}  // namespace rig
