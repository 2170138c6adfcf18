// SPDX-License-Identifier: MIT
#include "rig/report/explain_report.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "fit/explain/explanation.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/report/coordinate_in_words.hpp"
#include "rig/report/html_text.hpp"
#include "rig/report/plot.hpp"

namespace rig {
namespace {

using nlohmann::json;

std::string figure_of(double value, int digits = 4) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

/// What was located by a test that shows it; whoever needs the others finds them in the JSON.
json seen_of(const json& located) {
  constexpr double shows_nothing = 0.05;
  json out = json::array();
  for (const json& l : located)
    if (!(number_of(l, "p_value") > shows_nothing)) out.push_back(l);
  return out;
}

/// Empty where nothing was gained.
std::string gain_row(double gain) {
  constexpr double nothing = 0.01;
  if (!(std::abs(gain) >= nothing)) return "";
  return "<tr><td>log-likelihood gained, of all cells</td><td></td><td class=\"n\">" + figure_of(gain) +
         "</td></tr>\n";
}

std::string mechanism_section(const json& m) {
  std::string html =
      "<h3>" + escaped(m.at("mechanism").get<std::string>()) + " <span class=\"sub\">probability " +
      figure_of(m.at("probability").get<double>(), 3) + "</span></h3>\n<p class=\"box\">" +
      escaped(m.at("says").get<std::string>()) + "</p>\n<p>" + escaped(m.value("evidence", "")) +
      "</p>\n<table><thead><tr><th>Parameter</th><th class=\"n\">Value</th><th class=\"n\">Standard "
      "uncertainty</th></tr></thead><tbody>\n";
  for (const auto& [name, p] : m.at("parameters").items()) {
    if (p.is_string()) {
      html += "<tr><td>" + escaped(name) + "</td><td class=\"n\">" + escaped(p.get<std::string>()) +
              "</td><td></td></tr>\n";
      continue;
    }
    const double value = number_of(p, "value"), u = number_of(p, "u");
    html += "<tr><td>" + escaped(name) + "</td><td class=\"n\">" + fit::format_value(value, u) +
            "</td><td class=\"n\">" + fit::format_uncertainty(u) + "</td></tr>\n";
  }
  return html + "</tbody></table>\n";
}

std::string curve_section(const json& curve) {
  Plot plot;
  const CoordinateWords coordinate =
      curve.contains("target")
          ? CoordinateWords{"the place on target '" + curve.at("target").get<std::string>() + "'", "mm"}
          : coordinate_in_words(curve.at("coordinate").get<std::string>());
  plot.title = "Mean residual along " + coordinate.name;
  plot.x_label = coordinate.with_unit();
  plot.y_label = "recording - simulation (mm)";
  const auto x = curve.at("at").get<std::vector<double>>();
  const auto u = curve.at("u_mm").get<std::vector<double>>();
  plot.series.push_back(
      {"before", Series::Style::errorbars, x, curve.at("before_mm").get<std::vector<double>>(), u});
  plot.series.push_back(
      {"after", Series::Style::errorbars, x, curve.at("after_mm").get<std::vector<double>>(), u});
  return "<figure>" + to_svg(plot) + "<figcaption>Means over intervals of " + escaped(coordinate.name) +
         " with their standard uncertainties, after mount and targets were fitted; before: with the bench as "
         "it was; "
         "after: with what was found.</figcaption></figure>\n";
}

/// What whole scans, noise, echoes or memory do along a coordinate.
std::string spread_section(const json& curve) {
  const auto words = [&](const char* key) { return curve.at(key).get<std::string>(); };
  const auto numbers = [&](const char* key) { return curve.at(key).get<std::vector<double>>(); };
  Plot plot;
  plot.x_label =
      words("along").empty() ? coordinate_in_words(words("coordinate")).with_unit() : words("along");
  plot.y_label = CoordinateWords{words("shows"), words("unit")}.with_unit();
  const auto x = numbers("at");
  plot.series.push_back({"recorded", Series::Style::errorbars, x, numbers("recorded"), numbers("u")});
  plot.series.push_back({"before", Series::Style::line, x, numbers("before"), {}});
  plot.series.push_back({"after", Series::Style::line, x, numbers("after"), {}});
  return "<figure>" + to_svg(plot) +
         "<figcaption>As recorded, with standard uncertainties; before: as the simulation has it; after: "
         "with "
         "the mechanisms that were found.</figcaption></figure>\n";
}

/// A recording that took no part in the fit: figures, spread and means along the incidence.
std::string prediction_section(const json& p) {
  const json &before = p.at("before"), &after = p.at("after"), &cells = p.at("cells");
  const json& gain = p.at("log_likelihood_gain");
  const auto row = [&](const char* what, const char* key, int digits) {
    return "<tr><td>" + std::string(what) + "</td><td class=\"n\">" +
           figure_of(number_of(before, key), digits) + "</td><td class=\"n\">" +
           figure_of(number_of(after, key), digits) + "</td></tr>\n";
  };
  std::string html =
      "<h2>Predicted, not fitted: " + escaped(p.value("session", "")) + "</h2>\n<p>" +
      std::to_string(p.value("samples", 0L)) +
      " samples of a recording that took no part in the fit. Before: the bench's geometry and "
      "the constant noise "
      "that suits the fitted recordings best; after: with what was found in them. In both, "
      "only where mount and "
      "targets of this recording stand was fitted to it.</p>\n<table><thead><tr><th></th><th "
      "class=\"n\">before</th><th class=\"n\">after</th></tr></thead><tbody>\n" +
      row("rms of the samples (mm)", "rms_mm", 4) + row("rms of the means (mm)", "rms_of_means_mm", 4) +
      row("log-likelihood of a sample", "log_likelihood", 4) +
      row("share within the predicted 95 % intervals", "coverage_95", 3) +
      "</tbody></table>\n<p>All samples "
      "together are e^" +
      figure_of(number_of(gain, "value"), 3) + " times as likely (± " +
      figure_of(2 * number_of(gain, "u"), 2) + " in the exponent, k = 2, as beams differ).</p>\n";
  if (!cells.contains("incidence_deg")) return html;
  const auto column = [&](const char* key) { return cells.at(key).get<std::vector<double>>(); };
  const auto x = column("incidence_deg");
  Plot spread;
  spread.title = "Spread of the samples of a beam";
  spread.x_label = coordinate_in_words("incidence_deg").with_unit();
  spread.y_label = "standard deviation (mm)";
  spread.series.push_back({"recorded", Series::Style::points, x, column("sd_mm"), {}});
  spread.series.push_back({"predicted before", Series::Style::points, x, column("sd_before_mm"), {}});
  spread.series.push_back({"predicted after", Series::Style::points, x, column("sd_after_mm"), {}});
  Plot means = spread;
  means.title = "Mean of a beam's samples";
  means.y_label = "recording - prediction (mm)";
  means.series.clear();
  means.series.push_back({"before", Series::Style::points, x, column("mean_before_mm"), {}});
  means.series.push_back({"after", Series::Style::points, x, column("mean_after_mm"), {}});
  return html + "<figure>" + to_svg(spread) + "</figure>\n<figure>" + to_svg(means) + "</figure>\n";
}

}  // namespace

std::string explanation_html(const json& e, const std::string& sessions) {
  std::string html =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"generator\" "
      "content=\"rig explanation\"><title>Explanation</title><style>" +
      page_style() + "</style></head><body>\n<h1>What the simulation left out</h1>\n<p class=\"sub\">" +
      escaped(sessions) + " &middot; " + std::to_string(e.value("cells", 0L)) + " cells, " +
      std::to_string(e.value("samples", 0L)) +
      " samples &middot; ± is the expanded uncertainty (k = 2)</p>\n<p class=\"box\"><strong>" +
      escaped(verdict_in_words(e)) + "</strong></p>\n";
  if (!e.at("mechanisms").empty()) html += "<h2>Mechanisms</h2>\n";
  for (const json& m : e.at("mechanisms")) html += mechanism_section(m);
  for (const json& set : e.at("undecided_between")) {
    const auto suspects = fit::explain::suspects_in_words(set.get<std::vector<std::string>>());
    html += "<h2>Undecided</h2>\n<p class=\"box\">One of: " + escaped(fit::explain::listed(suspects, "or")) +
            ". The recording does not tell them apart.</p>\n";
  }
  if (e.contains("next_experiment") && e["next_experiment"].is_string())
    html += "<p>The experiment that separates them best: <code>" +
            escaped(e["next_experiment"].get<std::string>()) +
            "</code>, written as a procedure that can be run as it is.</p>\n";
  if (e.contains("unknown"))
    html += std::string(is_bench_error(e) ? "<h2>Correct the bench file</h2>" : "<h2>Unknown physics</h2>") +
            "\n<p class=\"box\">" + escaped(e["unknown"].value("describes", "")) +
            (is_bench_error(e)
                 ? ""
                 : " (" + escaped(observable_in_words(e["unknown"].value("observable", ""))) + ")") +
            ".</p>\n";
  const json& fit = e.at("fit");
  html +=
      "<h2>On data that the fit had not seen</h2>\n<table><thead><tr><th></th><th class=\"n\">before</th><th "
      "class=\"n\">after</th></tr></thead><tbody>\n<tr><td>rms of the means (mm)</td><td class=\"n\">" +
      figure_of(number_of(fit, "rms_before_mm")) + "</td><td class=\"n\">" +
      figure_of(number_of(fit, "rms_after_mm")) +
      "</td></tr>\n<tr><td>log-likelihood per cell</td><td class=\"n\">" +
      figure_of(number_of(fit, "held_out_log_likelihood_before")) + "</td><td class=\"n\">" +
      figure_of(number_of(fit, "held_out_log_likelihood_after")) + "</td></tr>\n" +
      gain_row(number_of(fit, "held_out_log_likelihood_gain")) +
      "<tr><td>share within the predicted 95 % intervals</td><td class=\"n\">" +
      figure_of(number_of(fit, "coverage_95_before"), 3) + "</td><td class=\"n\">" +
      figure_of(number_of(fit, "coverage_95_after"), 3) +
      "</td></tr>\n</tbody></table>\n<p>Noise floor of the means: " +
      figure_of(number_of(fit, "noise_floor_mm")) + " mm.</p>\n";
  if (e.contains("prediction"))
    for (const json& p : e["prediction"]) html += prediction_section(p);
  if (e.contains("spread_curves")) html += "<h2>Noise, echoes, intensity and whole scans</h2>\n";
  for (const json& curve : e.value("spread_curves", json::array())) html += spread_section(curve);
  if (!e.at("curves").empty()) html += "<h2>Residuals</h2>\n";
  for (const json& curve : e.at("curves")) html += curve_section(curve);
  if (const json located = seen_of(e.at("located")); !located.empty()) {
    html +=
        "<h2>Where they differ</h2>\n<table><thead><tr><th>Coordinate</th><th class=\"n\">from</th><th "
        "class=\"n\">to</th><th>Observable</th><th class=\"n\">p-value</th></tr></thead><tbody>\n";
    for (const json& l : located)
      html += "<tr><td>" + escaped(coordinate_in_words(l.at("coordinate").get<std::string>()).with_unit()) +
              "</td><td class=\"n\">" + figure_of(number_of(l, "from")) + "</td><td class=\"n\">" +
              figure_of(number_of(l, "to")) + "</td><td>" +
              escaped(observable_in_words(l.at("observable").get<std::string>())) + "</td><td class=\"n\">" +
              figure_of(number_of(l, "p_value"), 2) + "</td></tr>\n";
    html += "</tbody></table>\n";
  }
  if (!e.at("notes").empty()) html += "<h2>Notes</h2>\n";
  for (const json& note : e.at("notes")) html += "<p>" + escaped(note.get<std::string>()) + "</p>\n";
  return html + "</body></html>\n";
}

}  // namespace rig
