// SPDX-License-Identifier: MIT
#include "rig/report/report.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <kainjow/mustache.hpp>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "fit/bench.hpp"
#include "fit/explain/explanation.hpp"
#include "rig/errors.hpp"
#include "rig/number_format.hpp"
#include "rig/output_place.hpp"
#include "rig/report/child_program.hpp"
#include "rig/report/plot.hpp"
#include "rig/whole_file.hpp"

namespace rig {

extern const char* const certificate_template;

namespace {

using json = nlohmann::json;
namespace mustache = kainjow::mustache;

json parsed(const std::optional<std::string>& text) {
  if (!text) return json::object();
  json value = json::parse(*text, nullptr, false, true);
  return value.is_discarded() ? json::object() : value;
}

std::string text_of(const json& object, const char* key, const std::string& otherwise = "") {
  if (!object.is_object() || !object.contains(key)) return otherwise;
  const json& value = object.at(key);
  if (value.is_string()) return value.get<std::string>();
  return value.is_null() ? otherwise : value.dump();
}

double number_of(const json& object, const char* key, double otherwise = std::nan("")) {
  if (!object.is_object() || !object.contains(key) || !object.at(key).is_number()) return otherwise;
  return object.at(key).get<double>();
}

json list_of(const json& object, const char* key) {
  return object.is_object() && object.contains(key) && object.at(key).is_array() ? object.at(key)
                                                                                 : json::array();
}

void add(json& rows, const std::string& name, const std::string& text) {
  rows.push_back({{"name", name}, {"text", text.empty() ? "not stated" : text}});
}

// --- what the certificate says, as data ------------------------------------------------------------------

std::string join_nonempty(const std::vector<std::string>& parts, const std::string& separator) {
  std::string out;
  for (const std::string& part : parts)
    if (!part.empty()) out += (out.empty() ? "" : separator) + part;
  return out;
}

/// A VV/PP/II answer may be nested ({"VV": {...}}) or flat, depending on who recorded the session.
std::string device_text(const json& device, const char* key) {
  if (device.is_object() && device.contains(key)) return text_of(device, key);
  if (device.is_object())
    for (const auto& [name, part] : device.items())
      if (part.is_object() && part.contains(key)) return text_of(part, key);
  return "";
}

json identification(const SessionStore& session, const json& bench, const std::string& session_file) {
  const json lidar = parsed(session.get("lidar")), stage = parsed(session.get("stage"));
  const json stated = bench.value("certificate", json::object());
  json rows = json::array();
  add(rows, "Laboratory", text_of(stated, "laboratory"));
  add(rows, "Place", text_of(stated, "place"));
  add(rows, "Customer", text_of(stated, "customer"));
  add(rows, "Item calibrated",
      text_of(stated, "item",
              join_nonempty({device_text(lidar, "PROD"), device_text(lidar, "MODL")}, ", model ")));
  add(rows, "Serial number", device_text(lidar, "SERI"));
  add(rows, "Firmware", device_text(lidar, "FIRM"));
  add(rows, "Condition on receipt", text_of(stated, "item_condition"));
  add(rows, "Rotary stage",
      join_nonempty({text_of(stage, "model"), text_of(stage, "language"),
                     text_of(stage, "serial").empty() ? "" : "serial " + text_of(stage, "serial"),
                     text_of(stage, "firmware").empty() ? "" : "firmware " + text_of(stage, "firmware")},
                    ", "));
  std::string targets;
  for (const json& target : list_of(bench, "targets"))
    targets += (targets.empty() ? "" : ", ") + text_of(target, "name");
  add(rows, "Bench", text_of(bench, "name", targets.empty() ? "" : "targets: " + targets));
  add(rows, "Procedure", session.get("procedure_name").value_or(session.get("kind").value_or("")));
  add(rows, "Traceability", text_of(stated, "traceability"));
  add(rows, "Authorised by", text_of(stated, "authorised_by"));
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

json conditions(const SessionStore& session, const fit::Recording& recording) {
  Span temperature, warm, stage, started;
  for (const fit::CaptureInfo& capture : recording.captures()) {
    if (capture.temperature_c) temperature.include(*capture.temperature_c);
    if (capture.since_power_on_s) warm.include(*capture.since_power_on_s / 60);
    stage.include(capture.stage_rad * fit::deg_per_rad);
    started.include(static_cast<double>(capture.started_us) / 60e6);
  }
  json rows = json::array();
  add(rows, "Measured", session.get("created_utc").value_or(""));
  add(rows, "Captures", std::to_string(recording.captures().size()));
  add(rows, "Duration up to the last capture",
      started.empty() ? "" : Span{started.high - started.low, started.high - started.low}.text("min"));
  add(rows, "Stage angles", stage.text("deg", "%.2f"));
  add(rows, "Lidar housing", temperature.text("\u00b0C"));
  add(rows, "Time since power-on", warm.text("min", "%.0f"));
  return rows;
}

/// The mean echo of every beam of one capture, in the world frame, and the targets where the bench says they
/// are.
Plot scan_picture(const fit::Recording& recording, std::string& caption) {
  Plot plot{"", "x (mm)", "y (mm)", {}};
  plot.equal_axes = true;
  plot.height_px = 560;
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
    for (std::size_t i = 0; i < scan.range_mm.size(); ++i) {
      angle[i] = scan.geometry
                     ? scan.geometry->first_rad + static_cast<double>(i) * scan.geometry->step_rad
                     : bench.lidar.beam_angle(capture.first_step +
                                              (static_cast<double>(i) + 0.5) * capture.cluster - 0.5);
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

std::string certificate_number(const std::string& hash, const std::string& created) {
  std::string date;
  for (const char c : created.substr(0, 10))
    if (c != '-') date += c;
  return "RIG-" + (date.empty() ? "undated" : date) + "-" + hash.substr(0, 8);
}

// --- from data to the page -------------------------------------------------------------------------------

/// JSON to what the template engine reads. Empty arrays and nulls are false there.
mustache::data to_mustache(const json& value) {
  if (value.is_object()) {
    mustache::data object;
    for (const auto& [key, part] : value.items()) object.set(key, to_mustache(part));
    return object;
  }
  if (value.is_array()) {
    mustache::data list{mustache::data::type::list};
    for (const json& part : value) list.push_back(to_mustache(part));
    return list;
  }
  if (value.is_boolean())
    return value.get<bool>() ? mustache::data{mustache::data::type::bool_true}
                             : mustache::data{mustache::data::type::bool_false};
  if (value.is_null()) return mustache::data{mustache::data::type::bool_false};
  return mustache::data{value.is_string() ? value.get<std::string>() : value.dump()};
}

json shown_value(const json& value) {
  const double u = number_of(value, "u", 0);
  const double k = number_of(value, "k", coverage_factor(number_of(value, "nu_eff")));
  const double expanded = number_of(value, "U", k * u);
  char factor[32];
  std::snprintf(factor, sizeof factor, "%.2g", k);
  if (std::abs(k - 2) > 0.05) std::snprintf(factor, sizeof factor, "%.2f", k);
  const bool certain = expanded == 0;
  return {{"label", text_of(value, "label", text_of(value, "name"))},
          {"value", format_value(number_of(value, "value"), expanded)},
          {"unit", text_of(value, "unit")},
          {"expanded", certain ? "" : format_uncertainty(expanded) + " " + text_of(value, "unit")},
          {"k", certain ? "" : factor}};
}

/// Decimals a number needs to be written whole.
int decimals_of(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.6f", value);
  std::string digits = text;
  digits.erase(digits.find_last_not_of('0') + 1);
  return static_cast<int>(digits.size() - digits.find('.') - 1);
}

/// Decimals of all numbers in a column, so that they can be compared: four significant digits for a typical
/// one, two for an uncertainty. None where they span orders of magnitude.
std::optional<int> decimals_of_column(const json& body, std::size_t column, const std::string& name) {
  std::vector<double> sizes;
  int needed = 0;
  for (const json& row : body) {
    if (!row.is_array() || column >= row.size() || !row[column].is_number_float()) continue;
    const double value = row[column].get<double>();
    if (!std::isfinite(value) || value == 0) continue;
    sizes.push_back(std::abs(value));
    needed = std::max(needed, decimals_of(value));
  }
  if (sizes.empty()) return std::nullopt;
  std::sort(sizes.begin(), sizes.end());
  const bool uncertainty = name == "u" || name == "U" || name.starts_with("u(");
  const int significant = uncertainty ? 2 : 4;
  const double typical = uncertainty ? sizes.front() : sizes[sizes.size() / 2];
  if (sizes.back() > 1e4 * typical) return std::nullopt;
  const int decimals = significant - 1 - static_cast<int>(std::floor(std::log10(typical)));
  return std::clamp(decimals, std::min(2, needed), std::min(6, needed));
}

json shown_cell(const json& cell, std::optional<int> decimals) {
  if (cell.is_number_integer()) return {{"text", std::to_string(cell.get<long long>())}, {"numeric", true}};
  if (cell.is_number() && decimals && std::isfinite(cell.get<double>())) {
    char text[64];
    std::snprintf(text, sizeof text, "%.*f", *decimals, cell.get<double>());
    return {{"text", text}, {"numeric", true}};
  }
  if (cell.is_number()) return {{"text", format_value(cell.get<double>(), 0)}, {"numeric", true}};
  if (cell.is_null()) return {{"text", ""}, {"numeric", false}};
  if (cell.is_boolean()) return {{"text", cell.get<bool>() ? "yes" : "no"}, {"numeric", false}};
  return {{"text", cell.is_string() ? cell.get<std::string>() : cell.dump()}, {"numeric", false}};
}

json shown_table(const json& table) {
  json columns = json::array(), rows = json::array();
  const json body = list_of(table, "rows");
  std::vector<std::optional<int>> decimals;
  std::size_t i = 0;
  for (const json& column : list_of(table, "columns")) {
    const bool numeric = !body.empty() && body[0].is_array() && i < body[0].size() && body[0][i].is_number();
    const std::string name = column.is_string() ? column.get<std::string>() : text_of(column, "name");
    const std::string unit = column.is_object() ? text_of(column, "unit") : "";
    columns.push_back({{"text", unit.empty() ? name : name + " (" + unit + ")"}, {"numeric", numeric}});
    if (column.is_object() && column.contains("decimals"))
      decimals.push_back(column["decimals"].get<int>());
    else
      decimals.push_back(decimals_of_column(body, i, name));
    ++i;
  }
  for (const json& row : body) {
    json cells = json::array();
    for (std::size_t k = 0; row.is_array() && k < row.size(); ++k)
      cells.push_back(shown_cell(row[k], k < decimals.size() ? decimals[k] : std::nullopt));
    rows.push_back({{"cells", cells}});
  }
  constexpr std::size_t columns_of_a_page = 6;
  return {{"title", text_of(table, "title")},
          {"wide", columns.size() > columns_of_a_page},
          {"columns", columns},
          {"rows", rows}};
}

const std::map<std::string, std::string>& section_titles() {
  static const std::map<std::string, std::string> titles = {
      {"sensitivity", "Angular sensitivity at an edge"},
      {"centre", "Rotation centre"},
      {"range", "Range calibration"},
      {"range-intensity", "Range error against intensity"},
      {"range-distance", "Range error against distance"},
      {"validation", "Validation: as found and as left"},
      {"wall", "Right-angle wall calibration"},
      {"odometry", "Odometry and lidar pose"},
      {"deskew", "Motion distortion"},
      {"noise", "Noise as recorded"},
  };
  return titles;
}

json shown_section(const std::string& kind, const json& result) {
  const auto known = section_titles().find(kind);
  json section = {{"title", text_of(result, "title", known == section_titles().end() ? kind : known->second)},
                  {"method", text_of(result, "method")},
                  {"values", json::array()},
                  {"plots", json::array()},
                  {"tables", json::array()},
                  {"budget", json::array()},
                  {"notes", list_of(result, "notes")},
                  {"undetermined", list_of(result, "undetermined")}};
  for (const json& value : list_of(result, "values")) section["values"].push_back(shown_value(value));
  for (const json& plot : list_of(result, "plots"))
    section["plots"].push_back({{"svg", to_svg(plot_from_json(plot))}});
  for (const json& table : list_of(result, "tables")) section["tables"].push_back(shown_table(table));
  for (const json& row : list_of(result, "budget"))
    section["budget"].push_back({{"source", text_of(row, "source")},
                                 {"kind", text_of(row, "kind")},
                                 {"u", format_uncertainty(number_of(row, "u"))},
                                 {"unit", text_of(row, "unit")}});
  section["has_values"] = !section["values"].empty();
  section["has_budget"] = !section["budget"].empty();
  return section;
}

json shown_explanation(const json& explanation) {
  static const std::map<std::string, std::string> words = {
      {"nothing-missing", "Nothing is missing: the simulation predicts the recording to within its noise."},
      {"explained", "The simulation differed from the recording; what was left out has been found."},
      {"undecided", "Something is missing, but this recording cannot decide what."},
      {"unknown-physics", "Something is missing that no mechanism in the catalogue explains."}};
  const auto word = words.find(text_of(explanation, "verdict"));
  json out = {{"verdict", word == words.end() ? text_of(explanation, "verdict") : word->second},
              {"mechanisms", json::array()},
              {"undecided", json::array()},
              {"next", text_of(explanation, "next_experiment")}};
  for (const json& found : list_of(explanation, "mechanisms")) {
    char probability[32];
    std::snprintf(probability, sizeof probability, "%.3f", number_of(found, "probability"));
    out["mechanisms"].push_back({{"name", text_of(found, "mechanism")},
                                 {"probability", probability},
                                 {"says", text_of(found, "says")}});
  }
  for (const json& set : list_of(explanation, "undecided_between")) {
    std::vector<std::string> suspects;
    for (const json& name : set) suspects.push_back(name.is_string() ? name.get<std::string>() : name.dump());
    out["undecided"].push_back(fit::explain::listed(fit::explain::suspects_in_words(suspects), "or"));
  }
  const json fit = explanation.value("fit", json::object());
  if (fit.contains("rms_before_mm")) {
    char text[256];
    std::snprintf(
        text, sizeof text, "Residual rms before %.2f mm, after %.2f mm; noise floor %.2f mm (held-out data).",
        number_of(fit, "rms_before_mm"), number_of(fit, "rms_after_mm"), number_of(fit, "noise_floor_mm"));
    out["fit"] = text;
  }
  if (explanation.contains("unknown") && explanation.at("unknown").is_object())
    out["undecided"].push_back("unnamed structure along " + text_of(explanation.at("unknown"), "coordinate") +
                               ": " + text_of(explanation.at("unknown"), "describes"));
  return out;
}

json shown_checks(const json& limits) {
  json checks = json::array();
  for (const json& check : list_of(limits, "checks")) {
    const double expanded = number_of(check, "U", 0);
    const double low = number_of(check, "min"), high = number_of(check, "max");
    std::string range;
    if (std::isfinite(low) && std::isfinite(high))
      range = format_value(low, 0) + " to " + format_value(high, 0);
    else if (std::isfinite(low))
      range = "at least " + format_value(low, 0);
    else if (std::isfinite(high))
      range = "at most " + format_value(high, 0);
    if (const double widest = number_of(check, "max_U"); std::isfinite(widest))
      range += (range.empty() ? "U at most " : "; U at most ") + format_value(widest, 0);
    checks.push_back({{"name", text_of(check, "label", text_of(check, "name"))},
                      {"value", format_value(number_of(check, "value"), expanded)},
                      {"unit", text_of(check, "unit")},
                      {"expanded", expanded > 0 ? format_uncertainty(expanded) : ""},
                      {"limits", range},
                      {"verdict", text_of(check, "verdict", "inconclusive")},
                      {"reason", text_of(check, "reason")}});
  }
  return checks;
}

json overall_verdict(const json& checks) {
  if (checks.empty()) return nullptr;
  int failed = 0, open = 0;
  for (const json& check : checks) {
    failed += check.at("verdict") == "fail";
    open += check.at("verdict") != "fail" && check.at("verdict") != "pass";
  }
  if (failed > 0)
    return {
        {"class", "fail"},
        {"word", "FAIL"},
        {"text", std::to_string(failed) + " of " + std::to_string(checks.size()) + " requirements not met"}};
  if (open > 0)
    return {
        {"class", "inconclusive"},
        {"word", "INCONCLUSIVE"},
        {"text", std::to_string(open) + " of " + std::to_string(checks.size()) + " requirements undecided"}};
  return {{"class", "pass"},
          {"word", "PASS"},
          {"text", "all " + std::to_string(checks.size()) + " requirements met"}};
}

std::string shown_time(std::int64_t host_us) {
  char text[64];
  const double s = static_cast<double>(host_us) / 1e6;
  std::snprintf(text, sizeof text, "%d:%02d:%04.1f", static_cast<int>(s / 3600),
                static_cast<int>(std::fmod(s / 60, 60)), std::fmod(s, 60));
  return text;
}

void write_pdf(const std::string& html, const std::string& output, std::chrono::milliseconds longest) {
  write_beside(output, [&](const std::string& part) {
    const std::string page = part + ".html";
    write_file_atomically(page, html);
    const auto printing = run_child({"weasyprint", "-q", page, part}, longest).end;
    std::error_code ignored;
    std::filesystem::remove(page, ignored);
    if (printing == ChildResult::End::missing)
      throw UsageError(
          "PDF needs WeasyPrint: install the package 'weasyprint', or write .html and print it from a "
          "browser");
    if (printing == ChildResult::End::hung)
      throw MeasurementError(hung_in_words("WeasyPrint", longest) + ", so " + output +
                             " is not written: write .html and print it from a browser");
    if (printing != ChildResult::End::done || !std::filesystem::exists(part))
      throw UsageError("WeasyPrint could not write " + output + ": write .html and print it from a browser");
  });
}

}  // namespace

json make_certificate(const SessionStore& session, const std::string& session_file) {
  const auto recording = session.recording();
  const json bench = parsed(session.get("bench"));
  const std::string hash = session.content_hash(), created = session.get("created_utc").value_or("");
  json certificate = {{"schema", "certificate/1"},
                      {"title", "Calibration certificate"},
                      {"number", certificate_number(hash, created)},
                      {"created_utc", created},
                      {"software", "rig " RIG_VERSION},
                      {"session_software", session.get("software").value_or("")},
                      {"session_file", std::filesystem::path(session_file).filename().string()},
                      {"sha256", hash},
                      {"identification", identification(session, bench, session_file)},
                      {"conditions", conditions(session, *recording)},
                      {"results", json::array()},
                      {"events", noteworthy_events(session)}};
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
  std::string caption;
  const Plot picture = scan_picture(*recording, caption);
  if (!picture.series.empty()) certificate["scan_picture"] = {{"svg", to_svg(picture)}, {"caption", caption}};
  return certificate;
}

std::string to_html(const json& certificate) {
  json page = certificate;
  page["created"] = text_of(certificate, "created_utc");
  page["hash"] = text_of(certificate, "sha256");
  page["sections"] = json::array();
  json headline = json::array();
  for (const json& entry : list_of(certificate, "results")) {
    json section = shown_section(text_of(entry, "kind"), entry.value("result", json::object()));
    for (const json& value : section["values"])
      if (!value.at("expanded").get<std::string>().empty()) headline.push_back(value);
    page["sections"].push_back(std::move(section));
  }
  if (!headline.empty()) page["headline"] = {{"values", headline}};
  const json limits = certificate.value("limits", json::object());
  page["checks"] = shown_checks(limits);
  page["has_checks"] = !page["checks"].empty();
  page["rule"] = text_of(limits, "rule", "simple acceptance (ILAC-G8:09/2019, guard band w = 0)");
  page["verdict"] = overall_verdict(page["checks"]);
  if (certificate.contains("explanation"))
    page["explanation"] = shown_explanation(certificate.at("explanation"));
  for (json& event : page["events"]) event["time"] = shown_time(event.value("host_us", std::int64_t{0}));
  page["has_events"] = !page["events"].empty();
  page.erase("results");
  page.erase("limits");
  mustache::mustache layout{std::string(certificate_template)};
  return layout.render(to_mustache(page));
}

void write_report(const std::string& session_file, const std::string& output,
                  std::chrono::milliseconds longest_pdf) {
  check_outputs({{output, std::filesystem::path(session_file).stem().string() + ".html"}}, {session_file});
  const std::string ending = std::filesystem::path(output).extension().string();
  if (ending != ".html" && ending != ".pdf" && ending != ".json")
    throw UsageError("rig report writes .html, .pdf or .json, not '" + output +
                     "': give -o a name with one of these endings");
  const SessionStore session(session_file, SessionStore::Mode::read);
  const json certificate = make_certificate(session, session_file);
  if (ending == ".json")
    return write_file_atomically(output,
                                 certificate.dump(1, ' ', false, json::error_handler_t::replace) + "\n");
  const std::string html = to_html(certificate);
  if (ending == ".html") return write_file_atomically(output, html);
  write_pdf(html, output, longest_pdf);
}

}  // namespace rig
