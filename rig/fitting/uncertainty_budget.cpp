// SPDX-License-Identifier: MIT
#include "rig/fitting/uncertainty_budget.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/numeric/number_format.hpp"
#include "rig/fitting/result_document.hpp"

namespace rig {

using nlohmann::json;

void UncertaintyBudget::add(Contribution contribution) {
  contribution.u = std::abs(contribution.u);
  if (contribution.u > 0) contributions_.push_back(std::move(contribution));
}

void UncertaintyBudget::add(const fit::AccuracyLine& line, double contribution) {
  add({.source = line.name + (line.stated ? " (bench file)" : " (assumed: not stated)"),
       .distribution = "normal",
       .u = contribution,
       .input_u = line.u,
       .input_unit = line.unit});
}

double UncertaintyBudget::u() const {
  double sum = 0;
  for (const Contribution& c : contributions_) sum += c.u * c.u;
  return std::sqrt(sum);
}

double UncertaintyBudget::freedom() const {
  double sum = 0;
  for (const Contribution& c : contributions_)
    if (std::isfinite(c.freedom)) sum += std::pow(c.u, 4) / c.freedom;
  return sum > 0 ? std::pow(u(), 4) / sum : Contribution::many;
}

void UncertaintyBudget::publish(json& result, double value) const {
  const double nu = freedom();
  const bool few = std::isfinite(nu) && fit::coverage_factor(nu) > 2.005;
  result["values"].push_back(result_value(name_, label_, {value, u()}, unit_, few ? nu : 0));
  for (const Contribution& c : contributions_) {
    json row = budget_line(c.source, std::string(1, c.kind), c.u, unit_);
    row["quantity"] = name_, row["label"] = label_;
    row["distribution"] = c.distribution;
    row["nu"] = number_or_null(c.freedom);
    row["input_u"] = number_or_null(c.input_u > 0 ? c.input_u : c.u);
    row["input_unit"] = c.input_u > 0 ? c.input_unit : unit_;
    row["sensitivity"] = number_or_null(c.input_u > 0 ? c.u / c.input_u : 1);
    result["budget"].push_back(std::move(row));
  }
  if (contributions_.empty()) return;
  json combined = budget_line("combined", "combined", u(), unit_);
  combined["quantity"] = name_, combined["label"] = label_;
  combined["nu"] = number_or_null(nu);
  combined["k"] = result["values"].back()["k"], combined["U"] = result["values"].back()["U"];
  result["budget"].push_back(std::move(combined));
}

void compare_methods(json& result, const std::string& quantity, const MethodValue& first,
                     const MethodValue& second, const std::string& unit) {
  const auto expanded_of = [](const MethodValue& way) { return way.k * way.estimate.u; };
  const double difference = second.estimate.value - first.estimate.value,
               expanded = std::hypot(expanded_of(first), expanded_of(second));
  if (!std::isfinite(difference) || !std::isfinite(expanded)) return;
  const bool agree = std::abs(difference) <= expanded;
  const auto figure = [&](const MethodValue& way) {
    return way.method + ": " + fit::format_measurement(way.estimate.value, expanded_of(way), unit);
  };
  const auto document = [](const MethodValue& way) {
    return json{{"method", way.method}, {"value", way.estimate.value}, {"u", way.estimate.u}, {"k", way.k}};
  };
  result["comparisons"].push_back(
      {{"quantity", quantity},
       {"first", document(first)},
       {"second", document(second)},
       {"unit", unit},
       {"difference", difference},
       {"U", expanded},
       {"agree", agree},
       {"far_apart", std::abs(difference) > 1.5 * expanded},
       {"says", quantity + ", " + figure(first) + "; " + figure(second) +
                    "; difference: " + fit::format_measurement(difference, expanded, unit)}});
}

}  // namespace rig
