// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "rig/archive/history.hpp"
#include "rig/archive/page_parts.hpp"
#include "rig/report/plot.hpp"

namespace rig {
namespace {

using nlohmann::json;
using page::Cell;

std::string unit_of(const json& q) { return text_of(q, "unit"); }

double seconds_of(const std::string& utc) { return seconds_of_utc(utc).value_or(0); }

std::string drift_in_words(const json& q) {
  const json& drift = q.at("drift");
  if (drift.is_null()) return "\u2013";
  return fit::format_measurement(number_of(drift, "per_year"), number_of(drift, "U"),
                                 unit_of(q).empty() ? "a year" : unit_of(q) + " a year");
}

bool drifts(const json& q) { return q.at("drift").is_object() && q.at("drift").value("significant", false); }

std::string interval_in_words(const json& interval) {
  if (interval.is_null()) return "\u2013";
  const double months = number_of(interval, "months");
  return months < 1 ? "< 1 month" : page::counted(static_cast<std::size_t>(months), "month");
}

/// What a chart shows anyhow: values with their bars, and control limits.
std::pair<double, double> extent_of(const json& q) {
  double low = INFINITY, high = -INFINITY;
  for (const json& p : q.at("points")) {
    low = std::min(low, number_of(p, "value") - number_of(p, "U"));
    high = std::max(high, number_of(p, "value") + number_of(p, "U"));
  }
  if (const json& c = q.at("chart"); c.is_object()) {
    low = std::min(low, number_of(c, "lower"));
    high = std::max(high, number_of(c, "upper"));
  }
  return {low, high};
}

std::string required_in_words(const json& q) {
  const double least = number_of(q.at("required"), "min"), most = number_of(q.at("required"), "max");
  std::string words;
  if (std::isfinite(least)) words = "at least " + fit::with_unit(fit::format_value(least, 0), unit_of(q));
  if (std::isfinite(most))
    words +=
        (words.empty() ? "" : ", ") + ("at most " + fit::with_unit(fit::format_value(most, 0), unit_of(q)));
  return words;
}

Plot chart(const json& q) {
  Plot plot;
  plot.x_label = "date";
  plot.x_is_date = true;
  plot.y_label = unit_of(q).empty() ? text_of(q, "label") : text_of(q, "label") + " (" + unit_of(q) + ")";
  plot.height_px = 320;
  Series values{"calibration, k = 2", Series::Style::errorbars, {}, {}, {}},
      left{"as left, k = 2", Series::Style::errorbars, {}, {}, {}};
  for (const json& p : q.at("points")) {
    Series& series = text_of(p, "item_state") == "as left" ? left : values;
    series.x.push_back(seconds_of(text_of(p, "measured_utc")));
    series.y.push_back(number_of(p, "value"));
    series.u.push_back(number_of(p, "U"));
  }
  const double first = seconds_of(text_of(q.at("points").front(), "measured_utc")),
               last = seconds_of(text_of(q.at("points").back(), "measured_utc")),
               beside = std::max(0.02 * seconds_a_year, 0.03 * (last - first));
  const auto level = [&](const std::string& name, double at) {
    if (std::isfinite(at))
      plot.series.push_back({name, Series::Style::line, {first - beside, last + beside}, {at, at}, {}});
  };
  plot.series.push_back(values);
  plot.series.push_back(left);
  if (const json& c = q.at("chart"); c.is_object()) {
    level("centre line", number_of(c, "centre"));
    plot.series.push_back(
        {"control limits",
         Series::Style::line,
         {first - beside, last + beside, NAN, first - beside, last + beside},
         {number_of(c, "lower"), number_of(c, "lower"), NAN, number_of(c, "upper"), number_of(c, "upper")},
         {}});
  }
  if (const json& d = q.at("drift"); drifts(q)) {
    const std::size_t from = q.at("points").size() - d.at("calibrations").get<std::size_t>();
    const json &begin = q.at("points").at(from), &end = q.at("points").back();
    Series line{"drift", Series::Style::line, {}, {}, {}};
    for (const json* p : {&begin, &end}) {
      line.x.push_back(seconds_of(text_of(*p, "measured_utc")));
      line.y.push_back(number_of(d, "at_first") + number_of(d, "per_year") * number_of(*p, "years"));
    }
    plot.series.push_back(line);
  }
  // Requirements far away would press everything else into one line; the text names them.
  const auto [low, high] = extent_of(q);
  for (const auto& [key, name] :
       {std::pair{"min", "required, at least"}, std::pair{"max", "required, at most"}})
    if (const double at = number_of(q.at("required"), key);
        at > low - (high - low) && at < high + (high - low))
      level(name, at);
  return plot;
}

std::string points_table(const json& q) {
  std::vector<std::vector<Cell>> rows;
  for (const json& p : q.at("points")) {
    const double expanded = number_of(p, "U"), error = number_of(p, "e_n");
    rows.push_back({{page::day(text_of(p, "measured_utc"))},
                    {fit::format_value(number_of(p, "value"), expanded), true},
                    {expanded > 0 ? fit::format_uncertainty(expanded) : "not stated", true},
                    {p.contains("change") ? fit::format_value(number_of(p, "change"), expanded) : "", true},
                    {p.contains("change") ? page::fixed(error, 2) : "", true, std::abs(error) > 1},
                    {text_of(p, "item_state")},
                    {text_of(p, "session")}});
  }
  return page::table({{"Date"},
                      {"Value", true},
                      {"U (k = 2)", true},
                      {"Change", true},
                      {"E_n", true},
                      {"State"},
                      {"Session"}},
                     rows, true);
}

std::string quantity_section(const json& q) {
  std::string html = "<h2>" + escaped(text_of(q, "label")) + " <span class=\"sub\">" +
                     escaped(text_of(q, "quantity")) + "</span></h2>\n<figure>" + to_svg(chart(q)) +
                     "</figure>\n";
  if (const json& d = q.at("drift"); d.is_object())
    html += page::box("Drift: " + drift_in_words(q) + " (k = " + page::fixed(number_of(d, "k"), 2) +
                          ", p = " + page::two_digits(number_of(d, "p_value")) +
                          (drifts(q) ? "): it drifts." : "): no drift is shown."),
                      drifts(q));
  if (const json& c = q.at("chart"); c.is_object()) {
    for (const json& signal : c.at("signals")) {
      std::string when;
      for (const json& i : signal.at("points"))
        when += (when.empty() ? "" : ", ") +
                page::day(text_of(q.at("points").at(i.get<std::size_t>()), "measured_utc"));
      html += page::box(text_of(signal, "rule") + ": " + when + ".", true);
    }
    html += "<p class=\"sub\">Control limits: three standard deviations of " +
            escaped(fit::with_unit(fit::format_uncertainty(number_of(c, "sigma")), unit_of(q))) +
            " about the mean; from " + escaped(text_of(c, "limits_from")) + ".</p>\n";
  }
  if (const json& interval = q.at("interval"); interval.is_object())
    html += "<p>Next calibration after " + escaped(interval_in_words(interval)) + ": " +
            escaped(text_of(interval, "why")) + ".</p>\n";
  if (const std::string words = required_in_words(q); !words.empty())
    html += "<p>Required: " + escaped(words) + ".</p>\n";
  return html + points_table(q);
}

std::string overview(const json& quantities) {
  std::vector<std::vector<Cell>> rows;
  for (const json& q : quantities) {
    const json& newest = q.at("points").back();
    const double expanded = number_of(newest, "U"), error = number_of(newest, "e_n");
    std::string signals;
    if (q.at("chart").is_object())
      for (const json& s : q.at("chart").at("signals"))
        signals += (signals.empty() ? "" : ", ") + text_of(s, "rule").substr(0, text_of(s, "rule").find(':'));
    rows.push_back({{text_of(q, "label")},
                    {fit::format_measurement(number_of(newest, "value"), expanded, unit_of(q)), true},
                    {page::fixed(error, 2), true, std::abs(error) > 1},
                    {drift_in_words(q), true, drifts(q)},
                    {signals, false, !signals.empty()},
                    {interval_in_words(q.at("interval")), true}});
  }
  return page::table({{"Quantity"},
                      {"Newest value, k = 2", true},
                      {"E_n to the one before", true},
                      {"Drift, k = 2", true},
                      {"Control chart"},
                      {"Calibrate again after", true}},
                     rows);
}

}  // namespace

std::string history_html(const json& h) {
  const json& sessions = h.at("sessions");
  std::string html = page::head("history", "History of the lidar " + text_of(h, "serial"));
  const bool simulated =
      std::ranges::any_of(sessions, [](const json& s) { return s.value("simulated", false); });
  html += "<p class=\"sub\">" + escaped(text_of(h, "model")) + " &middot; " +
          page::counted(sessions.size(), "session") + ", " +
          page::day(text_of(sessions.front(), "measured_utc")) + " to " +
          page::day(text_of(sessions.back(), "measured_utc")) +
          (simulated ? " &middot; of simulated devices" : "") +
          " &middot; ± is the expanded uncertainty (k = 2)</p>\n";
  if (const json& r = h.at("recommended"); !r.at("months").is_null())
    html += page::box("Calibrate again after " + interval_in_words(r) + ", as " + text_of(r, "by") +
                      " asks for.");
  for (const json& note : h.at("notes")) html += page::box(note.get<std::string>(), true);
  html += overview(h.at("quantities"));
  html +=
      "<p class=\"sub\">E_n compares a calibration with the one before (ISO/IEC 17043): at most 1 agrees. "
      "Both rest on the "
      "same references, whose common error cancels, so that this E_n is conservative for what they do not "
      "share.</p>\n";
  for (const json& q : h.at("quantities")) html += quantity_section(q);
  html += "<h2>Sessions</h2>\n";
  std::vector<std::vector<Cell>> rows;
  for (const json& s : sessions)
    rows.push_back({{page::day(text_of(s, "measured_utc"))},
                    {text_of(s, "procedure")},
                    {text_of(s, "bench")},
                    {text_of(s, "item_state")},
                    {text_of(s, "explanation", "not explained")},
                    {text_of(s, "software")},
                    {text_of(s, "path")}});
  html +=
      page::table({{"Date"}, {"Procedure"}, {"Bench"}, {"State"}, {"Explanation"}, {"Software"}, {"Session"}},
                  rows, true);
  return html + page::end();
}

}  // namespace rig
