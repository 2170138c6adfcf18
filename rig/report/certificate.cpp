// SPDX-License-Identifier: MIT
#include "rig/report/certificate.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "fit/bench/accuracy.hpp"
#include "fit/bench/bench.hpp"
#include "fit/numeric/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/report/certificate_identity.hpp"
#include "rig/report/certificate_rows.hpp"
#include "rig/report/issue.hpp"
#include "rig/report/plot.hpp"
#include "rig/report/scene_picture.hpp"
#include "rig/report/unknown_physics.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/session/session_dates.hpp"
#include "rig/session/standing.hpp"
#include "rig/session/utc.hpp"

namespace rig {
namespace {

using json = nlohmann::json;

/// "2 mm" for an expanded uncertainty of 2; none is "not stated", for nothing is known without doubt.
std::string stated_uncertainty(double expanded, const std::string& unit) {
  return expanded > 0 ? fit::format_uncertainty(expanded) + " " + unit : "not stated";
}

/// What the results are referred to: the targets and the stage, as the bench file states them. Null without
/// targets.
json references(const fit::Bench& bench, const json& stated) {
  if (bench.targets.empty()) return nullptr;
  json targets = json::array();
  for (const fit::Target& target : bench.targets) {
    char reflectance[32] = "not stated";
    if (target.reflectance) std::snprintf(reflectance, sizeof reflectance, "%.2f", *target.reflectance);
    const double distance_mm = target.outward_normal().dot(target.from_mm);
    targets.push_back({{"name", target.name},
                       {"distance", fit::format_value(distance_mm, 2 * target.u_mm) + " mm"},
                       {"expanded", stated_uncertainty(2 * target.u_mm, "mm")},
                       {"expanded_angle", stated_uncertainty(2 * target.u_rad * fit::deg_per_rad, "deg")},
                       {"reflectance", reflectance}});
  }
  const std::string traceability = text_of(stated, "traceability");  // Empty as `rig new bench` writes it.
  return {{"targets", targets},
          {"traceability", traceability.empty() ? "not stated" : traceability},
          {"stage_resolution", fit::format_value(bench.stage_resolution_rad * fit::deg_per_rad, 0) + " deg"}};
}

/// Measuring equipment with what makes it traceable, as the bench file states it.
json equipment(const json& bench) {
  json rows = json::array();
  for (const json& item : list_of(bench.value("certificate", json::object()), "equipment"))
    rows.push_back({{"name", text_of(item, "name", "not stated")},
                    {"serial", text_of(item, "serial", "not stated")},
                    {"certificate", text_of(item, "certificate", "not stated")},
                    {"due", text_of(item, "due", "not stated")}});
  return rows;
}

/// What was allowed for in stage and lidar, and who says so.
json accuracy(const fit::Bench& bench) {
  json rows = json::array();
  for (const fit::AccuracyLine& line : fit::accuracy_in_words(fit::accuracy_of(bench)))
    if (line.u > 0)
      rows.push_back({{"name", line.name},
                      {"expanded", fit::with_unit(fit::format_uncertainty(2 * line.u), line.unit)},
                      {"by", line.stated ? "bench file" : "assumed: usual size"}});
  return rows;
}

/// ISO/IEC 17025, 7.8.4.1 d: results before and after an adjustment. The rig adjusts nothing.
json as_found(const json& results) {
  json values = json::array();
  for (const json& entry : results)
    for (const json& value : list_of(entry.value("result", json::object()), "values"))
      if (value.is_object() && value.contains("U") && value["U"].is_number())
        values.push_back({{"name", text_of(entry, "kind") + "." + text_of(value, "name")},
                          {"value", value.value("value", json())},
                          {"U", value["U"]},
                          {"unit", text_of(value, "unit")}});
  return values;
}

/// Whether the results are those before or after an adjustment; what they are not has none here.
std::string state_of_item(json& certificate, const std::string& stated) {
  if (stated == "as found") {
    certificate["as_left"] = json::array();
    return "results as found, before an adjustment; those as left are a calibration of their own";
  }
  if (stated == "as left") {
    certificate["as_found"] = json::array();
    return "results as left, after an adjustment; those as found are a calibration of their own";
  }
  return "not adjusted: results as found and as left are the same";
}

json noteworthy_events(const SessionStore& session) {
  json rows = json::array();
  for (const SessionStore::Event& event : session.events())
    if (event.level == "warning" || event.level == "error")
      rows.push_back({{"host_us", event.host_us}, {"level", event.level}, {"text", event.text}});
  return rows;
}

std::string certificate_number(const std::string& hash, const std::string& measured) {
  std::string date;
  for (const char c : measured.substr(0, 10))
    if (c != '-') date += c;
  return "RIG-" + (date.empty() ? "undated" : date) + "-" + hash.substr(0, 8);
}

/// The newest result of each kind, where the certificate has it.
void add_results(json& certificate, const SessionStore& session) {
  certificate["results"] = json::array();
  for (const SessionStore::Result& result : session.latest_results()) {
    const json document = json_or_empty(result.json);
    if (result.kind == "limits")
      certificate["limits"] = document;
    else if (result.kind == "explanation" || result.kind == "explain")
      certificate["explanation"] = document;
    else
      certificate["results"].push_back(
          {{"kind", result.kind}, {"created_utc", result.created_utc}, {"result", document}});
  }
  if (!certificate.contains("explanation")) return;
  if (json unknown = unknown_physics(certificate["explanation"]); !unknown.is_null())
    certificate["unknown_physics"] = std::move(unknown);
}

/// What else a result was made from: conditions and variables are those of the session that keeps it.
void add_recordings(json& certificate) {
  for (const json& result : certificate["results"]) {
    const json recordings = list_of(result.at("result"), "recordings");
    if (recordings.size() < 2) continue;
    std::string text;
    for (const json& recording : recordings) {
      text += (text.empty() ? "" : ", ") + text_of(recording, "file");
      if (const double captures = number_of(recording, "captures"); std::isfinite(captures))
        text += " (" + fit::format_fixed(captures, 0) + " captures)";
    }
    add_row(certificate["conditions"], "Recordings of the result " + text_of(result, "kind"),
            text + ". Variables and the conditions above are of the session that keeps it");
  }
}

std::string title_of(const json& certificate, const Standing& standing) {
  if (certificate["results"].empty()) return "Record of a measurement, without a calibration";
  const std::string what = standing.certifies() ? "Calibration certificate"
                           : standing.simulated ? "Report of a simulated calibration"
                                                : "Report";
  const int amendment = certificate["amendment"];
  return amendment == 0 ? what : what + ", amendment " + std::to_string(amendment);
}

/// Number and amendment: the same contents keep theirs.
void add_issue(json& certificate, const SessionStore& session, const std::string& date) {
  json identification = json::array();  // Whatever the session's file is called.
  for (const json& row : certificate["identification"])
    if (text_of(row, "name") != session_row) identification.push_back(row);
  json contents = {{"sha256", certificate["sha256"]},
                   {"identification", identification},
                   {"laboratory", certificate["laboratory"]},
                   {"results", as_found(certificate["results"])},
                   {"limits", certificate.value("limits", json())},
                   {"explanation", certificate.value("explanation", json())}};
  if (certificate.contains("previous")) contents["previous"] = certificate["previous"];
  const Issue issue = issue_of(session, certificate_number(certificate["sha256"], date), contents);
  certificate["number"] = issue.number, certificate["digest"] = issue.digest;
  certificate["amendment"] = issue.amendment;
  if (!issue.replaces.empty()) certificate["replaces"] = issue.replaces;
}

}  // namespace

json make_certificate(const SessionStore& session, const std::string& session_file) {
  return make_certificate(session, session_file, nullptr);
}

json make_certificate(const SessionStore& session, const std::string& session_file, const json& previous) {
  const auto recording = session.recording();
  const json bench = json_or_empty(session.get("bench"));
  const SessionDates dates = dates_of(session);
  json certificate = {{"schema", "certificate/1"},
                      {"created_utc", session.get("created_utc").value_or("")},
                      {"measured_utc", dates.measured_utc.empty() ? json() : json(dates.measured_utc)},
                      {"issued_utc", utc_text(std::time(nullptr))},
                      {"software", "rig " RIG_VERSION},
                      {"session_software", session.get("software").value_or("")},
                      {"session_file", std::filesystem::path(session_file).filename().string()},
                      {"sha256", session.content_hash()},
                      {"identification", identification(session, bench, session_file)},
                      {"conditions", conditions(session, bench, *recording)},
                      {"events", noteworthy_events(session)}};
  if (json all = references(recording->bench(), bench.value("certificate", json::object())); !all.is_null())
    certificate["references"] = std::move(all);
  if (!dates.imported_utc.empty()) certificate["imported_utc"] = dates.imported_utc;
  if (!dates.measured_local.empty()) certificate["measured_local"] = dates.measured_local;
  add_results(certificate, session);
  add_recordings(certificate);
  certificate["equipment"] = equipment(bench);
  certificate["accuracy"] = accuracy(recording->bench());
  certificate["as_found"] = as_found(certificate["results"]);
  certificate["as_left"] = certificate["as_found"];
  certificate["adjustment"] =
      state_of_item(certificate, text_of(bench.value("certificate", json::object()), "item_state"));
  certificate["laboratory"] = bench.value("certificate", json::object());
  const LidarIdentity lidar = lidar_of(session);
  certificate["item"] = {{"model", lidar.name()}, {"serial", lidar.serial}, {"firmware", lidar.firmware}};
  certificate["procedure"] = procedure_in_words(session);
  const Standing standing = standing_of(session);
  certificate["simulated"] = standing.simulated;
  certificate["certifies"] = standing.certifies() && !certificate["results"].empty();
  certificate["not_certified_because"] = standing.reasons;
  if (!previous.is_null()) certificate["previous"] = previous;
  add_issue(certificate, session, dates.measured());
  certificate["title"] = title_of(certificate, standing);
  if (const std::string how = unfinished(session); !how.empty()) certificate["unfinished"] = how;
  const ScenePicture picture = scene_picture(*recording);
  if (!picture.plot.series.empty())
    certificate["scan_picture"] = {{"svg", to_svg(picture.plot)}, {"caption", picture.caption}};
  return certificate;
}

}  // namespace rig
