// SPDX-License-Identifier: MIT
#include "rig/report/dossier_page.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "fit/mechanism.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/report/html_text.hpp"
#include "rig/report/plot.hpp"
#include "rig/text_lines.hpp"

namespace rig {
namespace {

using nlohmann::json;

std::string short_number(double value, int digits = 3) {
  return std::isfinite(value) ? fit::rounded(value, digits) : "-";
}

std::string minutes_of(const json& session) {
  const double machine = number_of(session, "stage_and_scans_min", 0),
               hand = number_of(session, "hand_min", 0);
  return duration_text(60 * (machine + hand)) +
         (hand > 0 ? " (" + duration_text(60 * hand) + " by hand)" : "");
}

bool has_data(const json& session) { return !session.value("without_data", false); }

/// Those that have data: "1 session", "3 sessions".
std::string sessions_in_words(const json& dossier) {
  const json rounds = list_of(dossier, "rounds");
  long sessions =
      std::ranges::count_if(rounds, [](const json& round) { return has_data(round.at("session")); });
  if (dossier.contains("last") && has_data(dossier["last"].at("session"))) ++sessions;
  return std::to_string(sessions) + (sessions == 1 ? " session" : " sessions");
}

std::string dossier_style() {
  return "body{font:14px/1.4 \"Source Sans 3\",\"DejaVu "
         "Sans\",sans-serif;color:#1a1a1a;max-width:54em;margin:1.5em auto;"
         "padding:0 1.2em}h1{font-size:1.6em;margin:.2em 0}h2{font-size:1.15em;margin:1.4em 0 "
         ".4em;border-bottom:2px solid "
         "#1a1a1a}h3{font-size:1em;margin:.9em 0 "
         ".2em}table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}"
         "th,td{text-align:left;vertical-align:top;padding:.22em .6em .22em 0;border-bottom:1px solid "
         "#cfcfcf}"
         "td.n,th.n{text-align:right}p{margin:.3em 0}.sub{color:#5a5a5a;font-weight:400;font-size:.9em}"
         ".box{border-left:.3em solid #006d4c;padding:.3em .9em;background:#f4f6f5;margin:.5em "
         "0}.box.no{border-color:#b02a00}"
         ".bar{font-size:.9em;line-height:1.3}.bar svg{vertical-align:baseline}th.wide{width:17em}"
         "figure{margin:.5em 0}figure svg{max-width:100%;height:auto}figcaption{color:#5a5a5a;"
         "font-size:.85em}code{font-size:.85em;word-break:break-all}.fresh{break-before:page}"
         "@page{size:A4;margin:16mm 15mm}@media "
         "print{body{margin:0;padding:0;font-size:12px}figure,.box,tr{break-inside:avoid}}";
}

std::string bars(const json& explanation) {
  std::string html;
  for (const json& s : list_of(explanation, "suspects")) {
    const double percent = 100 * std::clamp(number_of(s, "probability", 0), 0.0, 1.0);
    const bool in_set = s.value("set", false);
    const std::string width = short_number(0.9 * percent, 3);
    // The set's mark is not the colour alone.
    html +=
        "<div class=\"bar\"><svg width=\"90\" height=\"9\" viewBox=\"0 0 90 9\"><rect width=\"90\" "
        "height=\"9\" fill=\"#e6e9ec\"/><rect width=\"" +
        width + "\" height=\"9\" fill=\"" + (in_set ? "#e69f00" : "#0072b2") + "\"/></svg> " +
        (in_set ? "one of: " : short_number(percent, 3) + " % ") + escaped(text_of(s, "name")) + "</div>";
  }
  return html;
}

std::string rounds_in_table(const json& dossier) {
  std::string html =
      "<h2>How it was decided</h2>\n<table><thead><tr><th></th><th>Session, and why</th><th "
      "class=\"n\">Time</th>"
      "<th class=\"wide\">Suspects after all sessions so far</th></tr></thead><tbody>\n";
  int n = 0;
  for (const json& round : list_of(dossier, "rounds")) {
    const json& session = round.at("session");
    html += "<tr><td>" + std::to_string(++n) + "</td><td><strong>" + escaped(text_of(session, "title")) +
            "</strong><br>" + "<span class=\"sub\">" + escaped(text_of(session, "why")) +
            "</span></td><td class=\"n\">" + minutes_of(session) + "</td><td>" +
            (round.at("explanation").is_null() ? std::string("<span class=\"sub\">not yet explained</span>")
                                               : bars(round["explanation"])) +
            "</td></tr>\n";
  }
  return html +
         "</tbody></table>\n<p class=\"sub\">Blue: probability of the cause. Orange, \"one of\": the "
         "sessions so far do not distinguish these.</p>\n";
}

std::string physics_section(const json& found) {
  if (!found.is_object()) return "";
  std::string html;
  for (const json& m : list_of(found, "mechanisms"))
    html += "<h3>" + escaped(text_of(m, "mechanism")) + " <span class=\"sub\">probability " +
            short_number(number_of(m, "probability")) + "</span></h3>\n<p>" + escaped(text_of(m, "says")) +
            "</p>\n";
  if (found.contains("unknown"))
    html += std::string(is_bench_error(found) ? "<h3>Bench file and recording</h3>"
                                              : "<h3>Outside the catalogue</h3>") +
            "\n<p>" + escaped(text_of(found["unknown"], "describes")) + ".</p>\n";
  if (html.empty()) return "";
  return "<h2>The physics, in words</h2>\n" + html;
}

std::string open_section(const json& dossier) {
  const json open = list_of(dossier, "open");
  if (open.empty()) return "<h2>What remains open</h2>\n<p>Nothing that these sessions show.</p>\n";
  std::string html = "<h2>What remains open</h2>\n<ul>\n";
  for (const json& each : open) html += "<li>" + escaped(each.get<std::string>()) + "</li>\n";
  return html + "</ul>\n";
}

std::vector<double> column_of(const json& table, const char* key) {
  std::vector<double> values;
  for (const json& v : list_of(table, key)) values.push_back(v.is_number() ? v.get<double>() : std::nan(""));
  return values;
}

std::string comparison_pictures(const json& comparison) {
  const json& along = comparison.at("along_beam");
  const auto beam = column_of(along, "beam_deg");
  Plot plot;
  plot.title = "Recorded minus predicted, means over 3 deg of the beams";
  plot.x_label = "beam angle (deg)";
  plot.y_label = "difference (mm)";
  plot.width_px = 760, plot.height_px = 300;
  plot.series.push_back(
      {"by the bench file alone", Series::Style::points, beam, column_of(along, "before_mm"), {}});
  plot.series.push_back(
      {"as predicted", Series::Style::errorbars, beam, column_of(along, "off_mm"), column_of(along, "u_mm")});
  const json& pulls = comparison.at("pulls");
  // Every difference in its own uncertainty: a standard normal distribution if those are right.
  const auto at = column_of(pulls, "at");
  std::vector<double> normal;
  for (const double v : at)
    normal.push_back(number_of(pulls, "width") * std::exp(-v * v / 2) / std::sqrt(2 * std::numbers::pi));
  Plot histogram;
  histogram.title = "Means of single beams: difference in its own standard uncertainty";
  histogram.x_label = "difference / standard uncertainty";
  histogram.y_label = "share of the beams";
  histogram.width_px = 760, histogram.height_px = 300;
  histogram.series.push_back({"recorded", Series::Style::steps, at, column_of(pulls, "share"), {}});
  histogram.series.push_back({"if the uncertainties are right", Series::Style::line, at, normal, {}});
  return "<figure>" + to_svg(plot) +
         "<figcaption>Against the prediction, to which nothing was fitted, and against the bench file alone, "
         "for which mount and targets were "
         "fitted to this recording.</figcaption></figure>\n<figure>" +
         to_svg(histogram) + "</figure>\n";
}

std::string last_prediction_section(const json& last) {
  const json& session = last.at("session");
  std::string html = "<h2 class=\"fresh\">Prediction, and what was then recorded</h2>\n<p>" +
                     escaped(text_of(session, "title")) + ", " + minutes_of(session) +
                     ". What it would show was in <code>" + escaped(text_of(last, "prediction")) +
                     "</code> before the recording: SHA-256 <code>" + escaped(text_of(last, "sha256")) +
                     "</code>.</p>\n";
  const json& comparison = last.at("comparison");
  if (!comparison.is_object()) return html + "<p class=\"sub\">Not yet compared.</p>\n";
  const bool confirmed = comparison.value("confirmed", false);
  html += "<p class=\"box" + std::string(confirmed ? "" : " no") + "\"><strong>" +
          (confirmed ? "The prediction was confirmed." : "The prediction was not confirmed.") +
          "</strong></p>\n<ul>\n";
  for (const json& reason : list_of(comparison, "reasons"))
    html += "<li>" + escaped(reason.get<std::string>()) + "</li>\n";
  html += "</ul>\n";
  return comparison.contains("along_beam") ? html + comparison_pictures(comparison) : html;
}

std::string details_section(const json& dossier) {
  std::string html = "<h2 class=\"fresh\">Details</h2>\n";
  int n = 0;
  for (const json& round : list_of(dossier, "rounds")) {
    const json& session = round.at("session");
    const std::string name = escaped(text_of(session, "name"));
    html += "<h3>" + std::to_string(++n) + ". " + escaped(text_of(session, "title")) +
            "</h3>\n<p class=\"sub\">Files: " + name + ".yaml, " +
            (has_data(session) ? name + ".rig, " : "") + name + ".explanation.json</p>\n";
    if (!text_of(session, "failed").empty())
      html += (has_data(session) ? "<p>It ended early: " : "<p>It measured nothing: ") +
              escaped(text_of(session, "failed")) + "</p>\n";
    if (round.contains("comparison") && round["comparison"].is_object()) {
      html += "<p>It differs from the prediction:</p>\n<ul>\n";
      for (const json& reason : list_of(round["comparison"], "reasons"))
        html += "<li>" + escaped(reason.get<std::string>()) + "</li>\n";
      html += "</ul>\n";
    }
    if (const json considered = list_of(round, "considered"); !considered.empty()) {
      html +=
          "<table><thead><tr><th>Considered</th><th class=\"n\">expected (nats)</th><th "
          "class=\"n\">minutes</th><th class=\"n\">nats per "
          "minute</th><th>by hand</th></tr></thead><tbody>\n";
      for (const json& c : considered) {
        const double nats = number_of(c, "information", 0), minutes = number_of(c, "minutes", 0);
        html += "<tr><td>" + escaped(text_of(c, "title")) + "</td><td class=\"n\">" +
                (nats > 0 ? short_number(nats) : "-") + "</td><td class=\"n\">" + short_number(minutes) +
                "</td><td class=\"n\">" + (nats > 0 ? short_number(nats / std::max(minutes, 0.1), 2) : "-") +
                "</td><td>" + (c.value("needs_operator", false) ? "yes" : "no") + "</td></tr>\n";
      }
      html += "</tbody></table>\n";
    }
    for (const json& m : list_of(round.at("explanation"), "mechanisms"))
      html += "<p><strong>" + escaped(text_of(m, "mechanism")) +
              "</strong>: " + escaped(text_of(m, "evidence")) + "</p>\n";
    for (const json& note : list_of(round.at("explanation"), "notes"))
      html += "<p class=\"sub\">" + escaped(note.get<std::string>()) + "</p>\n";
  }
  const json& found = dossier.at("found");
  const json parameters = found.is_object() ? list_of(found, "mechanisms") : json::array();
  if (!parameters.empty()) {
    html +=
        "<h3>Sizes</h3>\n<table><thead><tr><th>Mechanism</th><th>Parameter</th><th class=\"n\">Value</th><th "
        "class=\"n\">Expanded uncertainty "
        "(k = 2)</th></tr></thead><tbody>\n";
    for (const json& m : parameters)
      for (const auto& [name, p] : m.at("parameters").items())
        html += "<tr><td>" + escaped(text_of(m, "mechanism")) + "</td><td>" + escaped(name) +
                "</td><td class=\"n\">" +
                (p.is_object() ? fit::format_value(number_of(p, "value"), 2 * number_of(p, "u", 0))
                               : escaped(p.is_string() ? p.get<std::string>() : p.dump())) +
                "</td><td class=\"n\">" +
                (p.is_object() ? fit::format_uncertainty(2 * number_of(p, "u", 0)) : "") + "</td></tr>\n";
    html += "</tbody></table>\n";
  }
  return html +
         "<h3>Files</h3>\n<p>The bench with all that was found, for <code>rig-sim --bench</code>: <code>" +
         escaped(text_of(dossier, "twin")) +
         "</code>. The bench file as it was given: <code>bench.json</code>, SHA-256 of its contents <code>" +
         escaped(text_of(dossier, "bench_sha256")) +
         "</code>. All of this for programs: <code>dossier.json</code>.</p>\n";
}

}  // namespace

std::string dossier_page(const json& dossier) {
  const bool confirmed = dossier.value("confirmed", false);
  std::string html =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"generator\" "
      "content=\"rig dossier\"><title>Dossier of an "
      "investigation</title><style>" +
      dossier_style() + "</style></head><body>\n<h1>What the bench file leaves out</h1>\n<p class=\"sub\">" +
      escaped(text_of(dossier, "lidar")) + " &middot; " + escaped(text_of(dossier, "software")) +
      " &middot; " + sessions_in_words(dossier) + ", " +
      duration_text(60 * number_of(dossier, "minutes", 0)) + ", of which by an operator " +
      duration_text(60 * number_of(dossier, "hand_minutes", 0)) +
      " &middot; ± is the expanded uncertainty (k = 2)</p>\n<p class=\"box" + (confirmed ? "" : " no") +
      "\"><strong>" + escaped(text_of(dossier, "claim")) + "</strong></p>\n";
  if (dossier.contains("end")) html += "<p>" + escaped(text_of(dossier["end"], "why")) + "</p>\n";
  html += physics_section(dossier.at("found")) + rounds_in_table(dossier) + open_section(dossier);
  if (dossier.contains("last")) html += last_prediction_section(dossier["last"]);
  return html + details_section(dossier) + "</body></html>\n";
}

}  // namespace rig
