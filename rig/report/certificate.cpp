// SPDX-License-Identifier: MIT
#include "rig/report/certificate.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <regex>

#include "fit/accuracy.hpp"
#include "fit/bench.hpp"
#include "fit/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/report/coordinate_in_words.hpp"
#include "rig/report/issue.hpp"
#include "rig/report/plot.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/session/session_dates.hpp"
#include "rig/session/sha256.hpp"
#include "rig/session/standing.hpp"
#include "rig/session/utc.hpp"
#include "rig/text_lines.hpp"

namespace rig {
namespace {

using json = nlohmann::json;

json parsed(const std::optional<std::string>& text) {
  if (!text) return json::object();
  json value = json::parse(*text, nullptr, false, true);
  return value.is_discarded() ? json::object() : value;
}

void add(json& rows, const std::string& name, const std::string& text) {
  rows.push_back({{"name", name}, {"text", text.empty() ? "not stated" : text}});
}

std::string join_nonempty(const std::vector<std::string>& parts, const std::string& separator) {
  std::string out;
  for (const std::string& part : parts)
    if (!part.empty()) out += (out.empty() ? "" : separator) + part;
  return out;
}

/// Name, version and hash of the procedure: what was done can be looked up, and that it was this.
std::string procedure_in_words(const SessionStore& session) {
  const std::string name = session.get("procedure_name").value_or(session.get("kind").value_or(""));
  const std::string text = session.get("procedure").value_or("");
  if (text.size() < 20) return name;
  Sha256 hash;
  hash.feed(text);
  std::smatch version;
  const bool has_version =
      std::regex_search(text, version, std::regex(R"((?:^|\n)version:\s*["']?([^"'\n#]+))"));
  return join_nonempty(
      {name, has_version ? "version " + version[1].str() : "", "SHA-256 " + hash.hex().substr(0, 16)}, ", ");
}

/// Variables that the run was given other values than the procedure's.
std::string changed_variables(const SessionStore& session) {
  const json used = parsed(session.get("variables"));
  const std::string text = session.get("procedure").value_or("");
  std::smatch block;
  if (!used.is_object() || used.empty() ||
      !std::regex_search(text, block, std::regex(R"((?:^|\n)variables:\s*\{([^}]*)\})")))
    return "";
  const std::string stated = block[1].str();
  std::string out;
  for (const auto& [name, value] : used.items()) {
    std::smatch was;
    if (!std::regex_search(stated, was,
                           std::regex("(?:^|,)\\s*" + name + ":\\s*\"?([^,\"]*?)\"?\\s*(?:,|$)")))
      continue;
    const std::string is = value.is_string() ? value.get<std::string>() : value.dump();
    char* end = nullptr;
    const double number = std::strtod(was[1].str().c_str(), &end);
    const bool same = value.is_number() ? number == value.get<double>() : was[1].str() == is;
    if (!same)
      out += (out.empty() ? "" : ", ") + name + " = " +
             (value.is_number() ? fit::format_value(value.get<double>(), 0) : is) +
             " (procedure: " + was[1].str() + ")";
  }
  return out.empty() ? "none" : out;
}

json identification(const SessionStore& session, const json& bench, const std::string& session_file) {
  const LidarIdentity lidar = lidar_of(session);
  const json stage = parsed(session.get("stage"));
  const json stated = bench.value("certificate", json::object());
  json rows = json::array();
  add(rows, "Laboratory", text_of(stated, "laboratory"));
  add(rows, "Address", text_of(stated, "address"));
  add(rows, "Place of calibration", text_of(stated, "place"));
  add(rows, "Customer",
      join_nonempty({text_of(stated, "customer"), text_of(stated, "customer_address")}, ", "));
  // The device that was there; what the bench file calls it may be of another time.
  const std::string told = lidar.product == lidar.model
                               ? lidar.model
                               : join_nonempty({lidar.product, lidar.model}, ", model "),
                    item = text_of(stated, "item");
  add(rows, "Item calibrated", told.empty() ? item : told);
  if (!told.empty() && !item.empty() && item != told) add(rows, "Item as the bench file calls it", item);
  add(rows, "Serial number", lidar.serial);
  add(rows, "Firmware", lidar.firmware);
  add(rows, "Received, condition",
      join_nonempty({text_of(stated, "received"), text_of(stated, "item_condition")}, ", "));
  add(rows, "Rotary stage",
      join_nonempty({text_of(stage, "model"), text_of(stage, "language"),
                     text_of(stage, "serial").empty() ? "" : "serial " + text_of(stage, "serial"),
                     text_of(stage, "firmware").empty() ? "" : "firmware " + text_of(stage, "firmware")},
                    ", "));
  std::string targets;
  for (const json& target : list_of(bench, "targets"))
    targets += (targets.empty() ? "" : ", ") + text_of(target, "name");
  add(rows, "Bench", text_of(bench, "name", targets.empty() ? "" : "targets: " + targets));
  add(rows, "Procedure", procedure_in_words(session));
  if (const std::string changed = changed_variables(session); !changed.empty())
    add(rows, "Variables changed", changed);
  add(rows, "Traceability", text_of(stated, "traceability"));
  add(rows, "Session", std::filesystem::path(session_file).filename().string());
  return rows;
}

struct Span {
  double low = INFINITY, high = -INFINITY;
  void include(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  [[nodiscard]] bool empty() const { return low > high; }
  [[nodiscard]] std::string text(const std::string& unit, const char* format = "%.1f") const {
    if (empty()) return "";
    char a[64], b[64];
    std::snprintf(a, sizeof a, format, low);
    std::snprintf(b, sizeof b, format, high);
    return std::string(a) + (std::string(a) == b ? "" : std::string(" to ") + b) + " " + unit;
  }
};

/// What prompts asked for, or the bench file states: temperature, humidity and light about the bench.
std::string environment(const SessionStore& session, const json& bench, const char* key, const char* unit) {
  for (const auto& [part, text] : session.progress()) {
    const json done = parsed(text);  // A step's; the scene's is a list.
    const json set = done.is_object() ? done.value("set", json::object()) : json::object();
    if (set.is_object() && set.contains(key) && set[key].is_number())
      return fit::format_value(set[key].get<double>(), 0) + " " + unit;
  }
  const std::string stated =
      text_of(bench.value("certificate", json::object()).value("environment", json::object()), key);
  return stated.empty() || !std::isdigit(static_cast<unsigned char>(stated.back())) ? stated
                                                                                    : stated + " " + unit;
}

json conditions(const SessionStore& session, const json& bench, const fit::Recording& recording) {
  Span temperature, warm, stage, started;
  for (const fit::CaptureInfo& capture : recording.captures()) {
    if (capture.temperature_c) temperature.include(*capture.temperature_c);
    if (capture.since_power_on_s) warm.include(*capture.since_power_on_s / 60);
    stage.include(capture.stage_rad * fit::deg_per_rad);
    started.include(static_cast<double>(capture.started_us) / 1e6);
  }
  json rows = json::array();
  const SessionDates dates = dates_of(session);
  add(rows, "Measured", dates.measured());
  if (!dates.imported_utc.empty()) add(rows, "Imported", dates.imported_utc);
  add(rows, "Captures", std::to_string(recording.captures().size()));
  add(rows, "Time from first to last capture",
      started.empty() ? "" : duration_text(started.high - started.low));
  add(rows, "Stage angles", stage.text("deg", "%.2f"));
  add(rows, "Ambient temperature", environment(session, bench, "temperature_c", "\u00b0C"));
  add(rows, "Relative humidity", environment(session, bench, "humidity_percent", "%"));
  add(rows, "Illuminance", environment(session, bench, "illuminance_lux", "lx"));
  add(rows, "Temperature of the lidar's housing", temperature.text("\u00b0C"));
  add(rows, "Time since power-on", warm.text("min", "%.0f"));
  return rows;
}

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
  return {{"targets", targets},
          {"traceability", text_of(stated, "traceability", "not stated")},
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
    return "as found: before an adjustment; the results as left are a calibration of their own";
  }
  if (stated == "as left") {
    certificate["as_found"] = json::array();
    return "as left: after an adjustment; the results as found are a calibration of their own";
  }
  return "none: the item was not adjusted, as left is as found";
}

/// The mean echo of every beam of one capture, in the world frame, and the targets where the bench says they
/// are.
Plot scan_picture(const fit::Recording& recording, std::string& caption) {
  Plot plot{"", "x (mm)", "y (mm)", {}};
  plot.equal_axes = true;
  plot.height_px = 440;
  const auto& captures = recording.captures();
  std::size_t widest = captures.size();
  for (std::size_t i = 0; i < captures.size(); ++i)
    if (widest == captures.size() || captures[i].beams() > captures[widest].beams()) widest = i;
  if (widest == captures.size()) return plot;
  const fit::CaptureInfo& capture = captures[widest];
  const fit::Bench& bench = recording.bench();
  std::vector<double> sum, count, angle;
  int scans = 0;
  recording.for_each_scan(widest, [&](const fit::ScanView& scan) {
    if (scans++ > 100) return;
    sum.resize(std::max(sum.size(), scan.range_mm.size()));
    count.resize(sum.size());
    angle.resize(sum.size());
    const fit::BeamAngles angles(bench.lidar, capture, scan.geometry);
    for (std::size_t i = 0; i < scan.range_mm.size(); ++i) {
      angle[i] = angles.at_rad(i);
      if (scan.range_mm[i] == 0) continue;
      sum[i] += scan.range_mm[i];
      count[i] += 1;
    }
  });
  const double theta = capture.stage_rad, yaw = bench.lidar.mount.yaw_rad.value;
  const double mx = bench.lidar.mount.x_mm.value, my = bench.lidar.mount.y_mm.value;
  const double ox = std::cos(theta) * mx - std::sin(theta) * my,
               oy = std::sin(theta) * mx + std::cos(theta) * my;
  Series echoes{"mean echo of each beam", Series::Style::points, {}, {}, {}};
  for (std::size_t i = 0; i < sum.size(); ++i) {
    if (count[i] == 0) continue;
    const double direction = theta + yaw + angle[i], range = sum[i] / count[i];
    echoes.x.push_back(ox + range * std::cos(direction));
    echoes.y.push_back(oy + range * std::sin(direction));
  }
  for (const fit::Target& target : bench.targets) {
    const Eigen::Vector2d shift = capture.target == target.name
                                      ? Eigen::Vector2d(target.outward_normal() * capture.target_shift_mm)
                                      : Eigen::Vector2d::Zero();
    plot.series.push_back({target.name + " (bench file)",
                           Series::Style::line,
                           {target.from_mm.x() + shift.x(), target.to_mm.x() + shift.x()},
                           {target.from_mm.y() + shift.y(), target.to_mm.y() + shift.y()},
                           {}});
  }
  plot.series.push_back(std::move(echoes));
  plot.series.push_back({"stage axis", Series::Style::points, {0}, {0}, {}});
  caption = "The scene in the world frame: capture " + std::to_string(capture.id) + " at stage angle " +
            Span{theta * fit::deg_per_rad, theta * fit::deg_per_rad}.text("deg", "%.2f") +
            ", beside the bench file's targets.";
  return plot;
}

json noteworthy_events(const SessionStore& session) {
  json rows = json::array();
  for (const SessionStore::Event& event : session.events())
    if (event.level == "warning" || event.level == "error")
      rows.push_back({{"host_us", event.host_us}, {"level", event.level}, {"text", event.text}});
  return rows;
}

std::string rounded(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

/// The largest effect that an explanation's unnamed function has along that coordinate.
std::string size_along(const json& explanation, const std::string& coordinate) {
  for (const json& part : list_of(explanation, "empirical_correction")) {
    if (text_of(part, "coordinate") != coordinate) continue;
    for (const auto& [key, unit] :
         {std::pair{"range_mm", " mm"}, {"beam_angle_deg", " deg"}, {"stage_angle_deg", " deg"}}) {
      double largest = 0;
      for (const json& value : list_of(part, key))
        if (value.is_number()) largest = std::max(largest, std::abs(value.get<double>()));
      if (largest > 0) return "up to " + rounded(largest) + unit;
    }
  }
  return "";
}

/// What the last explanation found and no mechanism makes: the calibration knows nothing of it. Null if it
/// found no such thing.
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
  add(rows, "What", text_of(unknown, "describes"));
  add(rows, "Seen in", observable_in_words(text_of(unknown, "observable")));
  add(rows, "Where", where);
  if (const std::string size = size_along(explanation, coordinate); !size.empty()) add(rows, "Size", size);
  return {{"rows", rows},
          {"says",
           "The recording shows an effect that no mechanism of the catalogue makes. The calibration does not "
           "contain it: neither its values nor their uncertainties allow for it."}};
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
    const json document = parsed(result.json);
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
  json contents = {{"sha256", certificate["sha256"]},
                   {"identification", certificate["identification"]},
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
  const json bench = parsed(session.get("bench"));
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
  const std::string ended = session.get("ended").value_or("");
  if (!ended.empty() && ended != "done") certificate["unfinished"] = ended;
  std::string caption;
  const Plot picture = scan_picture(*recording, caption);
  if (!picture.series.empty()) certificate["scan_picture"] = {{"svg", to_svg(picture)}, {"caption", caption}};
  return certificate;
}

}  // namespace rig
