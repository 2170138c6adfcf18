// SPDX-License-Identifier: MIT
#include "rig/report/unknown_physics.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/report/certificate_rows.hpp"
#include "rig/report/coordinate_in_words.hpp"

namespace rig {
namespace {

using nlohmann::json;

std::string rounded(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

/// The largest effect that an explanation's unnamed function has along that coordinate.
std::string size_along(const json& explanation, const std::string& coordinate) {
  for (const json& part : list_of(explanation, "empirical_correction")) {
    if (text_of(part, "coordinate") != coordinate) continue;
    for (const auto& [key, unit] : {std::pair{"range_mm", " mm"},
                                    {"range_mm_per_m", " mm/m"},
                                    {"beam_angle_deg", " deg"},
                                    {"stage_angle_deg", " deg"}}) {
      double largest = 0;
      for (const json& value : list_of(part, key))
        if (value.is_number()) largest = std::max(largest, std::abs(value.get<double>()));
      if (largest > 0) return "up to " + rounded(largest) + unit;
    }
  }
  return "";
}

}  // namespace

json unknown_physics(const json& explanation) {
  const json unknown = explanation.is_object() ? explanation.value("unknown", json()) : json();
  const bool said = text_of(explanation, "verdict") == "unknown-physics";
  if (!unknown.is_object() && !said) return nullptr;
  const std::string coordinate = text_of(unknown, "coordinate");
  const double from = number_of(unknown, "from"), to = number_of(unknown, "to");
  std::string where = coordinate.empty() ? "" : "along " + coordinate_in_words(coordinate).name;
  if (std::isfinite(from) && std::isfinite(to))
    where +=
        " from " + rounded(from) + " to " + fit::with_unit(rounded(to), coordinate_in_words(coordinate).unit);
  json rows = json::array();
  add_row(rows, "What", text_of(unknown, "describes"));
  add_row(rows, "Seen in", observable_in_words(text_of(unknown, "observable")));
  add_row(rows, "Where", where);
  if (const std::string size = size_along(explanation, coordinate); !size.empty())
    add_row(rows, "Size", size);
  const bool bench_error = is_bench_error(explanation);
  return {
      {"rows", rows},
      {"heading", bench_error ? "Bench file and recording" : "Unknown physics"},
      {"says",
       bench_error
           ? "The bench file and the recording do not agree. What the calibration takes from the bench file "
             "may be wrong."
           : "The recording shows an effect that no mechanism of the catalogue produces. The calibration "
             "does not "
             "contain it: neither its values nor their uncertainties allow for it."}};
}

}  // namespace rig
