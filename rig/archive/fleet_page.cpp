// SPDX-License-Identifier: MIT
#include <cmath>
#include <nlohmann/json.hpp>

#include "rig/archive/fleet.hpp"
#include "rig/archive/page_parts.hpp"
#include "rig/report/coordinate_in_words.hpp"
#include "rig/report/plot.hpp"

namespace rig {
namespace {

using nlohmann::json;
using page::Cell;
using page::counted;

std::string figure(double value) { return fit::format_value(value, 0); }

std::string listed_some(const json& names) {
  constexpr std::size_t most = 12;
  std::string out;
  for (std::size_t i = 0; i < std::min(names.size(), most); ++i)
    out += (i ? ", " : "") + names[i].get<std::string>();
  return names.size() > most ? out + " and " + std::to_string(names.size() - most) + " more" : out;
}

std::size_t count_in(const json& object, const char* key) { return object.at(key).get<std::size_t>(); }

std::string summary(const json& f) {
  std::string models, verdicts;
  for (const json& m : f.at("models"))
    models +=
        (models.empty() ? "" : ", ") + std::to_string(count_in(m, "lidars")) + " " + text_of(m, "model");
  for (const auto& [verdict, n] : f.at("verdicts").items())
    verdicts += (verdicts.empty() ? "" : ", ") + n.dump() + " " + verdict;
  return "<p class=\"sub\">" + escaped(models) + " &middot; " + counted(count_in(f, "sessions"), "session") +
         ", " + page::day(text_of(f, "first_utc")) + " to " + page::day(text_of(f, "last_utc")) +
         (f.value("simulated", false) ? " &middot; simulated devices among them" : "") +
         " &middot; ± is the expanded uncertainty (k = 2)</p>\n<p>Explanations: " + escaped(verdicts) +
         ".</p>\n";
}

std::string findings(const json& f) {
  std::string html;
  for (const json& s : f.at("strange")) {
    const std::string whose = text_of(s, "looks_like");
    html += page::box(
        "The session " + text_of(s, "session") + " (" + page::day(text_of(s, "measured_utc")) +
            ") names the lidar " + text_of(s, "serial") +
            ", but its results do not match that lidar (chi-squared " + figure(number_of(s, "chi_squared")) +
            " for " + std::to_string(count_in(s, "quantities")) + " degrees of freedom). " +
            (whose.empty()
                 ? "They match no other known lidar either: it was damaged, adjusted, or measured "
                   "differently."
                 : "They match " + whose + " (" + figure(number_of(s, "chi_squared_of_other")) +
                       "): the serial numbers may have been swapped." +
                       (count_in(s, "also_like") > 0
                            ? " They match " + counted(count_in(s, "also_like"), "other lidar") + " as well."
                            : "")),
        true);
  }
  for (const json& shape : f.at("unknown"))
    if (count_in(shape, "lidars") > 1)
      html +=
          page::box("The same unknown physics in " + counted(count_in(shape, "lidars"), "lidar") + " and " +
                        counted(shape.at("sessions").size(), "session") + ": " + text_of(shape, "describes") +
                        ". It is one finding, and a candidate for a mechanism of its own.",
                    true);
  if (!f.at("drifts").empty()) {
    std::string who;
    for (const json& d : f.at("drifts"))
      if (who.find(text_of(d, "serial")) == std::string::npos)
        who += (who.empty() ? "" : ", ") + text_of(d, "serial");
    html += page::box("These lidars drift: " + who + ".", true);
  }
  for (const json& c : f.at("common_drifts"))
    html += page::box("All " + text_of(c, "model") + " drift together in " + text_of(c, "quantity") + " by " +
                          fit::format_measurement(number_of(c, "per_year"), number_of(c, "U"), "") +
                          " a year: check the bench and its references first.",
                      true);
  return html.empty()
             ? page::box("No session is suspicious, no lidar drifts, and no unknown physics is shared.")
             : html;
}

std::string drifts_section(const json& f) {
  std::vector<std::vector<Cell>> rows;
  for (const json& d : f.at("drifts")) {
    const std::string unit = text_of(d, "unit");
    rows.push_back({{text_of(d, "serial")},
                    {text_of(d, "label")},
                    {fit::format_measurement(number_of(d, "per_year"), number_of(d, "U"),
                                             unit.empty() ? "a year" : unit + " a year"),
                     true},
                    {page::two_digits(number_of(d, "common_per_year")), true},
                    {std::to_string(count_in(d, "calibrations")), true},
                    {page::two_digits(number_of(d, "p_value")), true}});
  }
  std::string html = "<h2>Drifts</h2>\n";
  if (!rows.empty())
    html += page::table({{"Lidar"},
                         {"Quantity"},
                         {"Drift, k = 2", true},
                         {"All lidars (median)", true},
                         {"Calibrations", true},
                         {"p-value", true}},
                        rows);
  return html + "<p class=\"sub\">" + counted(count_in(f, "drifts_looked_at"), "line") +
         " examined; of those listed, one in a hundred may be chance (Benjamini and Hochberg).</p>\n";
}

std::string unknown_section(const json& f) {
  if (f.at("unknown").empty()) return "";
  std::string html = "<h2>Unknown physics, by shape</h2>\n";
  for (const json& shape : f.at("unknown")) {
    const CoordinateWords coordinate = coordinate_in_words(text_of(shape, "coordinate"));
    html += "<h3>" + escaped(text_of(shape, "form") + " along " + coordinate.name) + " <span class=\"sub\">" +
            counted(count_in(shape, "lidars"), "lidar") + ", " +
            counted(shape.at("sessions").size(), "session") + "</span></h3>\n" +
            page::box(text_of(shape, "describes") + " (" + observable_in_words(text_of(shape, "observable")) +
                      ").") +
            "<p>Lidars: " + escaped(listed_some(shape.at("serials"))) +
            "; typical session: " + escaped(text_of(shape, "typical")) + ".</p>\n";
    if (shape.at("curve").empty()) continue;
    Plot plot;
    plot.height_px = 260;
    plot.x_label = coordinate.with_unit();
    const std::string channel = text_of(shape, "channel");
    plot.y_label = channel == "range_mm"         ? "range (mm)"
                   : channel == "range_mm_per_m" ? "range's scale (mm/m)"
                                                 : "angle (deg)";
    plot.series.push_back({"mean of the sessions",
                           Series::Style::line,
                           shape.at("at").get<std::vector<double>>(),
                           shape.at("curve").get<std::vector<double>>(),
                           {}});
    html += "<figure>" + to_svg(plot) + "</figure>\n";
  }
  return html;
}

std::string mechanisms_section(const json& f) {
  if (f.at("mechanisms").empty()) return "";
  std::vector<std::vector<Cell>> rows, sizes;
  for (const json& m : f.at("mechanisms")) {
    rows.push_back({{text_of(m, "mechanism")},
                    {std::to_string(count_in(m, "sessions")), true},
                    {std::to_string(count_in(m, "lidars")), true},
                    {figure(number_of(m, "least_probability")), true},
                    {listed_some(m.at("serials"))}});
    for (const json& s : m.at("sizes"))
      sizes.push_back({{text_of(m, "mechanism")},
                       {text_of(s, "parameter")},
                       {text_of(s, "model")},
                       {std::to_string(s.at("age_years").get<int>()) + " to " +
                            std::to_string(s.at("age_years").get<int>() + 1),
                        true},
                       {std::to_string(count_in(s, "sessions")), true},
                       {figure(number_of(s, "median")), true},
                       {figure(number_of(s, "least")) + " to " + figure(number_of(s, "most")), true}});
  }
  return "<h2>Mechanisms named</h2>\n" +
         page::table(
             {{"Mechanism"}, {"Sessions", true}, {"Lidars", true}, {"Least probability", true}, {"Which"}},
             rows) +
         "<h3>Their sizes, by model and age</h3>\n" +
         page::table({{"Mechanism"},
                      {"Parameter"},
                      {"Model"},
                      {"Age (years)", true},
                      {"Sessions", true},
                      {"Median", true},
                      {"Range", true}},
                     sizes, true) +
         "<p class=\"sub\">Age: since the first calibration in the archive.</p>\n";
}

std::string undecided_section(const json& f) {
  if (f.at("undecided").empty()) return "";
  std::vector<std::vector<Cell>> rows;
  for (const json& u : f.at("undecided"))
    rows.push_back({{text_of(u, "between")},
                    {std::to_string(count_in(u, "sessions")), true},
                    {std::to_string(count_in(u, "lidars")), true},
                    {listed_some(u.at("serials"))}});
  return "<h2>Undecided</h2>\n" +
         page::table({{"One of"}, {"Sessions", true}, {"Lidars", true}, {"Which"}}, rows);
}

std::string repeatability_section(const json& f) {
  std::vector<std::vector<Cell>> rows;
  for (const json& r : f.at("repeatability"))
    rows.push_back({{text_of(r, "model")},
                    {text_of(r, "quantity")},
                    {fit::format_uncertainty(number_of(r, "sigma")), true},
                    {std::to_string(count_in(r, "differences")), true},
                    {r.value("enough", false) ? "" : "too few to be used"}});
  if (rows.empty()) return "";
  return "<h2>How well calibrations repeat</h2>\n" +
         page::table({{"Model"}, {"Quantity"}, {"Standard deviation", true}, {"Pairs", true}, {""}}, rows,
                     true) +
         "<p class=\"sub\">From one calibration to the next of the same lidar: median moving range. Control "
         "limits and drifts rest on it.</p>\n";
}

}  // namespace

std::string fleet_html(const json& f) {
  return page::head("fleet", "The fleet") + summary(f) + "<h2>Findings</h2>\n" + findings(f) +
         drifts_section(f) + unknown_section(f) + mechanisms_section(f) + undecided_section(f) +
         repeatability_section(f) + page::end();
}

}  // namespace rig
