// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/report/html_text.hpp"

namespace rig::page {

// What the pages of an archive are put together from. Every text that a session may hold passes through
// escaped().

inline std::string head(const std::string& kind, const std::string& title) {
  return "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
         "content=\"width=device-width, initial-scale=1\"><meta name=\"generator\" content=\"rig " +
         kind + "\"><title>" + escaped(title) + "</title><style>" + page_style() +
         ".bad{color:#b02a00;font-weight:600}.small td,.small "
         "th{font-size:.85em}th{vertical-align:bottom}td{vertical-align:top}"
         ".warn{border-left-color:#b02a00}.scroll{overflow-x:auto}td.n{white-space:nowrap}</style></"
         "head><body>\n<h1>" +
         escaped(title) + "</h1>\n";
}

inline std::string end() { return "</body></html>\n"; }

/// A cell: escaped text; numeric cells stand right.
struct Cell {
  std::string text;
  bool is_number = false, is_bad = false;
};

inline std::string table(const std::vector<Cell>& columns, const std::vector<std::vector<Cell>>& rows,
                         bool is_small = false) {
  std::string html =
      std::string("<div class=\"scroll\"><table") + (is_small ? " class=\"small\"" : "") + "><thead><tr>";
  for (const Cell& c : columns)
    html += std::string(c.is_number ? "<th class=\"n\">" : "<th>") + escaped(c.text) + "</th>";
  html += "</tr></thead><tbody>\n";
  for (const auto& row : rows) {
    html += "<tr>";
    for (const Cell& c : row)
      html += std::string(c.is_number ? "<td class=\"n\">" : "<td>") +
              (c.is_bad ? "<span class=\"bad\">" : "") + escaped(c.text) + (c.is_bad ? "</span>" : "") +
              "</td>";
    html += "</tr>\n";
  }
  return html + "</tbody></table></div>\n";
}

inline std::string box(const std::string& text, bool is_warning = false) {
  return std::string("<p class=\"box") + (is_warning ? " warn" : "") + "\">" + escaped(text) + "</p>\n";
}

/// "2026-05-04" of a date with its time.
inline std::string day(const std::string& utc) { return utc.size() >= 10 ? utc.substr(0, 10) : "no date"; }

inline std::string fixed(double value, int decimals) {
  return std::isfinite(value) ? fit::format_fixed(value, decimals) : "\u2013";
}

/// "7.7e-28": two digits of a number of any size.
inline std::string two_digits(double p) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2g", p);
  return std::isfinite(p) ? text : "\u2013";
}

/// "3 sessions", "1 session".
inline std::string counted(std::size_t n, const std::string& one) {
  return std::to_string(n) + " " + one + (n == 1 ? "" : "s");
}

}  // namespace rig::page
