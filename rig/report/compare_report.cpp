// SPDX-License-Identifier: MIT
#include "rig/report/compare_report.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/explain/explanation.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/report/html_text.hpp"
#include "rig/report/plot.hpp"

namespace rig {
namespace {

using fit::RecordingStatistic;
using nlohmann::json;

constexpr double always_alike = 0.1;  ///< A distance below this is not seen in a plot.
/// How often one device is told from itself, in any statistic.
constexpr double false_alarms = 0.05;
constexpr double times_own = 2;     ///< A device that changes within a recording changes between two as well.
constexpr double too_coarse = 0.5;  ///< Where not even this distance would be seen, nothing can be said.

std::string three_digits(double value) {
  if (!std::isfinite(value)) return "&ndash;";
  const double unit = std::pow(10.0, std::floor(std::log10(std::abs(value))) - 2);
  if (std::abs(value) >= 1000) return fit::format_fixed(std::round(value / unit) * unit, 0);
  return fit::formatted("%.3g", value);
}

double quantile(std::vector<double> v, double share) {
  if (v.empty()) return NAN;
  const auto at = v.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(v.size() - 1));
  std::ranges::nth_element(v, at);
  return *at;
}

struct Verdict {
  double distance = NAN, own = NAN;
  double p = NAN;  ///< By Holm, for all statistics together.
  std::string says;
};

const std::vector<double>& values_of(const fit::RecordingStatistics& statistics, std::size_t i) {
  return statistics.statistics[i].values;
}

/// The distance between the halves of the device that is farther from itself.
double own_distance(const Comparison& c, std::size_t i) {
  double own = NAN;
  for (const ComparedDevice* device : {&c.recorded, &c.other})
    own = std::fmax(
        own, fit::distribution_distance(values_of(device->first_half, i), values_of(device->second_half, i)));
  return own;
}

/// Of every statistic.
std::vector<Verdict> judge(const Comparison& c) {
  const std::size_t count = c.recorded.all.statistics.size();
  std::vector<Verdict> out(count);
  std::vector<std::size_t> compared;
  for (std::size_t i = 0; i < count; ++i) {
    const auto &a = values_of(c.recorded.all, i), &b = values_of(c.other.all, i);
    out[i].distance = fit::distribution_distance(a, b);
    out[i].own = own_distance(c, i);
    if (a.empty() || b.empty()) {
      out[i].says = a.empty() && b.empty() ? "not seen in either" : "seen in one only";
      continue;
    }
    out[i].p = fit::distance_probability(out[i].distance, a.size(), b.size());
    compared.push_back(i);
  }
  std::ranges::sort(compared, {}, [&](std::size_t i) { return out[i].p; });
  double largest = 0;
  for (std::size_t k = 0; k < compared.size(); ++k) {
    double& p = out[compared[k]].p;
    p = largest = std::max(largest, std::min(1.0, p * static_cast<double>(compared.size() - k)));
  }
  for (const std::size_t i : compared) {
    Verdict& v = out[i];
    const double seen_at_best = fit::distance_probability(too_coarse, values_of(c.recorded.all, i).size(),
                                                          values_of(c.other.all, i).size());
    if (v.distance <= always_alike)
      v.says = "agrees";
    else if (v.p < false_alarms)
      v.says = v.distance <= times_own * v.own ? "undecided" : "differs";
    else
      v.says = seen_at_best * static_cast<double>(compared.size()) < false_alarms ? "agrees" : "undecided";
  }
  return out;
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
  const RecordingStatistic& a = c.recorded.all.statistics[i];
  const RecordingStatistic& b = c.other.all.statistics[i];
  if (a.values.empty() && b.values.empty()) return "";
  Plot plot;
  plot.title = a.name;
  plot.x_label = with_unit(a.name, a.unit);
  plot.y_label = "share of values below (%)";
  plot.width_px = 560;
  plot.height_px = 320;
  if (!a.values.empty()) plot.series.push_back(distribution(c.recorded.name, a.values));
  if (!b.values.empty()) plot.series.push_back(distribution(c.other.name, b.values));
  return "<figure>" + to_svg(plot) + "<figcaption>" + escaped(a.what) + ".</figcaption></figure>\n";
}

std::string profile(const Comparison& c, std::size_t i) {
  const fit::RangeProfile& a = c.recorded.all.profiles[i];
  const fit::RangeProfile& b = c.other.all.profiles[i];
  if (a.value.size() < 2 && b.value.size() < 2) return "";  // One distance is no line.
  Plot plot;
  plot.title = a.name + " against range";
  plot.x_label = "range (mm)";
  plot.y_label = with_unit(a.name, a.unit);
  plot.width_px = 560;
  plot.height_px = 320;
  plot.series.push_back({c.recorded.name, Series::Style::line, a.range_mm, a.value, {}});
  plot.series.push_back({c.other.name, Series::Style::line, b.range_mm, b.value, {}});
  return "<figure>" + to_svg(plot) + "<figcaption>In steps of 250 mm.</figcaption></figure>\n";
}

/// "recorded: a.rig, b.rig (1200 scans, 97200 samples)"
std::string described(const ComparedDevice& device) {
  return escaped(device.name) + ": " + escaped(fit::explain::listed(device.files)) + " (" +
         std::to_string(device.all.scans) + " scans, " + std::to_string(device.all.samples) + " samples)";
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
  const std::vector<Verdict> verdicts = judge(c);
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    const Verdict& v = verdicts[i];
    const auto& a = c.recorded.all.statistics[i];
    const auto& b = c.other.all.statistics[i];
    list.push_back({{"statistic", a.name},
                    {"unit", a.unit},
                    {"median", {number(quantile(a.values, 0.5)), number(quantile(b.values, 0.5))}},
                    {"values", {a.values.size(), b.values.size()}},
                    {"distance", number(v.distance)},
                    {"own_distance", number(v.own)},
                    {"p_value", number(v.p)},
                    {"verdict", v.says}});
  }
  return {{"schema", "comparison/1"},
          {"recorded", c.recorded.name},
          {"other", c.other.name},
          {"files", {c.recorded.files, c.other.files}},
          {"scans", {c.recorded.all.scans, c.other.all.scans}},
          {"statistics", list}};
}

std::string comparison_html(const Comparison& c) {
  std::string html =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"generator\" "
      "content=\"rig comparison\"><title>Two devices "
      "compared</title><style>" +
      compare_style() + "</style></head><body>\n<h1>Two devices compared</h1>\n<p class=\"sub\">" +
      described(c.recorded) + "; " + described(c.other) + "</p>\n";
  html += "<table><thead><tr><th>Statistic</th><th class=\"n\">" + escaped(c.recorded.name) +
          "<br>median (5 % to 95 %)</th><th class=\"n\">" + escaped(c.other.name) +
          "<br>median (5 % to 95 %)</th><th class=\"n\">distance</th><th class=\"n\">p</th><th "
          "class=\"n\">own</th><th></th></tr></thead><tbody>\n";
  const std::vector<Verdict> verdicts = judge(c);
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    const auto& a = c.recorded.all.statistics[i];
    const auto& b = c.other.all.statistics[i];
    const Verdict& v = verdicts[i];
    const auto cell = [](const std::vector<double>& values) {
      return "<td class=\"n\">" +
             (values.empty()
                  ? std::string("not seen")
                  : three_digits(quantile(values, 0.5)) + " (" + three_digits(quantile(values, 0.05)) +
                        " to " + three_digits(quantile(values, 0.95)) + ")") +
             "</td>";
    };
    html += "<tr><td>" + escaped(with_unit(a.name, a.unit)) + "</td>" + cell(a.values) + cell(b.values) +
            "<td class=\"n\">" + three_digits(v.distance) + "</td><td class=\"n\">" + three_digits(v.p) +
            "</td><td class=\"n\">" + three_digits(v.own) + "</td><td class=\"" +
            (v.says == "agrees" ? "yes" : "no") + "\">" + v.says + "</td></tr>\n";
  }
  html +=
      "</tbody></table>\n<p class=\"sub\">Distance: the largest vertical distance between the two "
      "distribution functions "
      "(Kolmogorov and Smirnov), 0 to 1. p: how often one device differs so from itself, with as many "
      "values, by "
      "Holm for all statistics together. Below " +
      three_digits(false_alarms) + " a statistic differs, unless the distance is at most " +
      three_digits(always_alike) +
      ", which no plot shows. Own: the distance between both halves of a recording in time, of the device "
      "where it is larger; within " +
      three_digits(times_own) +
      " times that a difference is undecided. So is one of so few values that a distance of " +
      three_digits(too_coarse) + " would not be seen.</p>\n";
  std::string profiles;
  for (std::size_t i = 0; i < c.recorded.all.profiles.size(); ++i) profiles += profile(c, i);
  if (!profiles.empty()) html += "<h2>Against range</h2>\n<div class=\"plots\">\n" + profiles + "</div>\n";
  html += "<h2>Distributions</h2>\n<div class=\"plots\">\n";
  for (std::size_t i = 0; i < verdicts.size(); ++i) html += picture(c, i);
  return html + "</div>\n</body></html>\n";
}

}  // namespace rig
