// SPDX-License-Identifier: MIT
#include "rig/report/shown_numbers.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"

namespace rig {
namespace {

using nlohmann::json;

/// Decimals a number needs to be written whole.
int decimals_of(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.6f", value);
  std::string digits = text;
  digits.erase(digits.find_last_not_of('0') + 1);
  return static_cast<int>(digits.size() - digits.find('.') - 1);
}

/// Decimals of all numbers in a column, so that they can be compared: four significant digits for a typical
/// one, two for an uncertainty. None where they span orders of magnitude.
std::optional<int> decimals_of_column(const json& body, std::size_t column, const std::string& name) {
  std::vector<double> sizes;
  int needed = 0;
  for (const json& row : body) {
    if (!row.is_array() || column >= row.size() || !row[column].is_number_float()) continue;
    const double value = row[column].get<double>();
    if (!std::isfinite(value) || value == 0) continue;
    sizes.push_back(std::abs(value));
    needed = std::max(needed, decimals_of(value));
  }
  if (sizes.empty()) return std::nullopt;
  std::sort(sizes.begin(), sizes.end());
  const bool uncertainty = name == "u" || name == "U" || name.starts_with("u(") || name.starts_with("U(");
  const int significant = uncertainty ? 2 : 4;
  const double typical = uncertainty ? sizes.front() : sizes[sizes.size() / 2];
  if (sizes.back() > 1e4 * typical) return std::nullopt;
  const int decimals = significant - 1 - static_cast<int>(std::floor(std::log10(typical)));
  return std::clamp(decimals, std::min(2, needed), std::min(6, needed));
}

json shown_cell(const json& cell, std::optional<int> decimals) {
  constexpr std::size_t letters_of_a_line = 30;
  if (cell.is_number_integer()) return {{"text", std::to_string(cell.get<long long>())}, {"numeric", true}};
  if (cell.is_number() && decimals && std::isfinite(cell.get<double>()))
    return {{"text", fit::format_fixed(cell.get<double>(), *decimals)}, {"numeric", true}};
  if (cell.is_number()) return {{"text", fit::format_value(cell.get<double>(), 0)}, {"numeric", true}};
  if (cell.is_null()) return {{"text", ""}, {"numeric", false}};
  if (cell.is_boolean()) return {{"text", cell.get<bool>() ? "yes" : "no"}, {"numeric", false}};
  const std::string text = cell.is_string() ? cell.get<std::string>() : cell.dump();
  return {{"text", text}, {"numeric", false}, {"short", text.size() <= letters_of_a_line}};
}

}  // namespace

json shown_value(const json& value) {
  const double u = number_of(value, "u", 0);
  const double k = number_of(value, "k", fit::coverage_factor(number_of(value, "nu_eff")));
  const double expanded = number_of(value, "U", k * u);
  char factor[32];
  std::snprintf(factor, sizeof factor, "%.2g", k);
  if (std::abs(k - 2) > 0.05) std::snprintf(factor, sizeof factor, "%.2f", k);
  const bool certain = expanded == 0;
  return {{"label", text_of(value, "label", text_of(value, "name"))},
          {"value", fit::format_value(number_of(value, "value"), expanded)},
          {"unit", text_of(value, "unit")},
          {"expanded", certain ? "" : fit::format_uncertainty(expanded) + " " + text_of(value, "unit")},
          {"k", certain ? "" : factor}};
}

json shown_table(const json& table) {
  json columns = json::array(), rows = json::array();
  const json body = list_of(table, "rows");
  std::vector<std::optional<int>> decimals;
  std::size_t i = 0;
  for (const json& column : list_of(table, "columns")) {
    const bool numeric = !body.empty() && body[0].is_array() && i < body[0].size() && body[0][i].is_number();
    const std::string name = column.is_string() ? column.get<std::string>() : text_of(column, "name");
    const std::string unit = column.is_object() ? text_of(column, "unit") : "";
    columns.push_back({{"text", unit.empty() ? name : name + " (" + unit + ")"}, {"numeric", numeric}});
    if (column.is_object() && column.contains("decimals"))
      decimals.push_back(column["decimals"].get<int>());
    else
      decimals.push_back(decimals_of_column(body, i, name));
    ++i;
  }
  for (const json& row : body) {
    json cells = json::array();
    for (std::size_t k = 0; row.is_array() && k < row.size(); ++k)
      cells.push_back(shown_cell(row[k], k < decimals.size() ? decimals[k] : std::nullopt));
    rows.push_back({{"cells", cells}});
  }
  constexpr std::size_t columns_of_a_page = 6;
  return {{"title", text_of(table, "title")},
          {"wide", columns.size() > columns_of_a_page},
          {"columns", columns},
          {"rows", rows}};
}

}  // namespace rig
