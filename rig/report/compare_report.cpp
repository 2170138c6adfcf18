// SPDX-License-Identifier: MIT
#include "rig/report/compare_report.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "rig/report/html_text.hpp"
#include "rig/report/plot.hpp"

namespace rig {
namespace {

using fit::RecordingStatistic;
using nlohmann::json;

/// A distance below this is not seen in a plot; a device differs from itself by some of it from hour to hour.
constexpr double always_alike = 0.1;
constexpr double times_own = 2;
constexpr double too_unsteady = 0.2;  ///< Too few values, or a device that changes: nothing can be said.

std::string four_digits(double value) {
  if (!std::isfinite(value)) return "&ndash;";
  char text[40];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

double quantile(std::vector<double> v, double share) {
  if (v.empty()) return NAN;
  const auto at = v.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(v.size() - 1));
  std::ranges::nth_element(v, at);
  return *at;
}

struct Verdict {
  double distance = NAN, own = NAN;
  std::string says;
};

Verdict judge(const Comparison& c, std::size_t i) {
  const auto& a = c.recorded.statistics[i].values;
  const auto& b = c.other.statistics[i].values;
  Verdict v;
  v.distance = fit::distribution_distance(a, b);
  v.own = fit::distribution_distance(c.first_half.statistics[i].values, c.second_half.statistics[i].values);
  if (!std::isfinite(v.distance))
    v.says = a.empty() && b.empty() ? "not seen in either" : "seen in one only";
  else if (v.distance <= always_alike)
    v.says = "agrees";
  else if (!(v.own < too_unsteady))
    v.says = v.distance > times_own * v.own ? "differs" : "undecided";
  else
    v.says = v.distance <= times_own * v.own ? "agrees" : "differs";
  return v;
}

/// Distribution function as a line of at most a few hundred points.
Series distribution(const std::string& name, std::vector<double> v) {
  std::ranges::sort(v);
  Series series{name, Series::Style::line, {}, {}, {}};
  const std::size_t step = std::max<std::size_t>(1, v.size() / 300);
  for (std::size_t i = 0; i < v.size(); i += step) {
    series.x.push_back(v[i]);
    series.y.push_back(100.0 * static_cast<double>(i + 1) / static_cast<double>(v.size()));
  }
  return series;
}

std::string with_unit(const std::string& name, const std::string& unit) {
  return unit.empty() ? name : name + " (" + unit + ")";
}

std::string picture(const Comparison& c, std::size_t i) {
  const RecordingStatistic& a = c.recorded.statistics[i];
  const RecordingStatistic& b = c.other.statistics[i];
  if (a.values.empty() && b.values.empty()) return "";
  Plot plot;
  plot.title = a.name;
  plot.x_label = with_unit(a.name, a.unit);
  plot.y_label = "share of values below (%)";
  plot.width_px = 560;
  plot.height_px = 320;
  if (!a.values.empty()) plot.series.push_back(distribution(c.name, a.values));
  if (!b.values.empty()) plot.series.push_back(distribution(c.other_name, b.values));
  return "<figure>" + to_svg(plot) + "<figcaption>" + escaped(a.what) + ".</figcaption></figure>\n";
}

std::string profile(const Comparison& c, std::size_t i) {
  const fit::RangeProfile& a = c.recorded.profiles[i];
  const fit::RangeProfile& b = c.other.profiles[i];
  if (a.value.empty() && b.value.empty()) return "";
  Plot plot;
  plot.title = a.name + " against range";
  plot.x_label = "range (mm)";
  plot.y_label = with_unit(a.name, a.unit);
  plot.width_px = 560;
  plot.height_px = 320;
  plot.series.push_back({c.name, Series::Style::line, a.range_mm, a.value, {}});
  plot.series.push_back({c.other_name, Series::Style::line, b.range_mm, b.value, {}});
  return "<figure>" + to_svg(plot) + "<figcaption>In steps of 250 mm.</figcaption></figure>\n";
}

std::string compare_style() {
  return "body{font:15px/1.45 \"Source Sans 3\",\"DejaVu "
         "Sans\",sans-serif;color:#1a1a1a;max-width:74rem;margin:2rem "
         "auto;padding:0 1.2rem}h1{font-size:1.7rem}h2{font-size:1.2rem;margin-top:2rem;border-bottom:2px "
         "solid "
         "#1a1a1a}table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}th,td{text-"
         "align:left;"
         "padding:.28rem .6rem .28rem 0;border-bottom:1px solid "
         "#cfcfcf;vertical-align:top}td.n,th.n{text-align:right}"
         ".sub{color:#5a5a5a}.yes{color:#006d4c;font-weight:600}.no{color:#b03000;font-weight:600}"
         ".plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(30rem,1fr));gap:0 1.5rem}"
         "figure{margin:1rem 0;break-inside:avoid}figure svg{max-width:100%;height:auto}"
         "figcaption{color:#5a5a5a;font-size:.9rem}@page{size:A4;margin:16mm}";
}

}  // namespace

json comparison_json(const Comparison& c) {
  json list = json::array();
  const auto number = [](double v) { return std::isfinite(v) ? json(v) : json(nullptr); };
  for (std::size_t i = 0; i < c.recorded.statistics.size(); ++i) {
    const Verdict v = judge(c, i);
    const auto& a = c.recorded.statistics[i];
    const auto& b = c.other.statistics[i];
    list.push_back({{"statistic", a.name},
                    {"unit", a.unit},
                    {"median", {number(quantile(a.values, 0.5)), number(quantile(b.values, 0.5))}},
                    {"values", {a.values.size(), b.values.size()}},
                    {"distance", number(v.distance)},
                    {"own_distance", number(v.own)},
                    {"verdict", v.says}});
  }
  return {{"schema", "comparison/1"},
          {"recorded", c.name},
          {"other", c.other_name},
          {"scans", {c.recorded.scans, c.other.scans}},
          {"statistics", list}};
}

std::string comparison_html(const Comparison& c) {
  std::string html =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"generator\" "
      "content=\"rig comparison\"><title>Two devices "
      "compared</title><style>" +
      compare_style() + "</style></head><body>\n<h1>Two devices compared</h1>\n<p class=\"sub\">" +
      escaped(c.name) + " (" + std::to_string(c.recorded.scans) + " scans, " +
      std::to_string(c.recorded.samples) + " samples) and " + escaped(c.other_name) + " (" +
      std::to_string(c.other.scans) + " scans, " + std::to_string(c.other.samples) + " samples)</p>\n";
  html += "<table><thead><tr><th>Statistic</th><th class=\"n\">" + escaped(c.name) +
          "<br>median (5 % to 95 %)</th><th class=\"n\">" + escaped(c.other_name) +
          "<br>median (5 % to 95 %)</th><th class=\"n\">distance</th><th class=\"n\">its "
          "halves</th><th></th></tr></thead><tbody>\n";
  for (std::size_t i = 0; i < c.recorded.statistics.size(); ++i) {
    const auto& a = c.recorded.statistics[i];
    const auto& b = c.other.statistics[i];
    const Verdict v = judge(c, i);
    const auto cell = [](const std::vector<double>& values) {
      return "<td class=\"n\">" +
             (values.empty()
                  ? std::string("not seen")
                  : four_digits(quantile(values, 0.5)) + " (" + four_digits(quantile(values, 0.05)) + " to " +
                        four_digits(quantile(values, 0.95)) + ")") +
             "</td>";
    };
    html += "<tr><td>" + escaped(with_unit(a.name, a.unit)) + "</td>" + cell(a.values) + cell(b.values) +
            "<td class=\"n\">" + four_digits(v.distance) + "</td><td class=\"n\">" + four_digits(v.own) +
            "</td><td class=\"" + (v.says == "agrees" ? "yes" : "no") + "\">" + v.says + "</td></tr>\n";
  }
  html +=
      "</tbody></table>\n<p class=\"sub\">Distance: the largest vertical distance between the two "
      "distribution functions "
      "(Kolmogorov and Smirnov), 0 to 1. A statistic agrees when that is at most " +
      four_digits(always_alike) + ", or at most " + four_digits(times_own) +
      " times the distance between the two halves of " + escaped(c.name) +
      " in time; where those differ by more than " + four_digits(too_unsteady) +
      ", it is undecided.</p>\n<h2>Against range</h2>\n<div class=\"plots\">\n";
  for (std::size_t i = 0; i < c.recorded.profiles.size(); ++i) html += profile(c, i);
  html += "</div>\n<h2>Distributions</h2>\n<div class=\"plots\">\n";
  for (std::size_t i = 0; i < c.recorded.statistics.size(); ++i) html += picture(c, i);
  return html + "</div>\n</body></html>\n";
}

}  // namespace rig
