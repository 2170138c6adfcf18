// SPDX-License-Identifier: MIT
#include "rig/report/certificate_identity.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>
#include <vector>

#include "fit/number_format.hpp"
#include "rig/json_fields.hpp"
#include "rig/report/certificate_rows.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/session/session_dates.hpp"
#include "rig/session/sha256.hpp"
#include "rig/text_lines.hpp"

namespace rig {
namespace {

using nlohmann::json;

std::string join_nonempty(const std::vector<std::string>& parts, const std::string& separator) {
  std::string out;
  for (const std::string& part : parts)
    if (!part.empty()) out += (out.empty() ? "" : separator) + part;
  return out;
}

/// Variables that the run was given other values than the procedure's.
std::string changed_variables(const SessionStore& session) {
  const json used = json_or_empty(session.get("variables"));
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
    const json done = json_or_empty(text);  // A step's; the scene's is a list.
    const json set = done.is_object() ? done.value("set", json::object()) : json::object();
    if (set.is_object() && set.contains(key) && set[key].is_number())
      return fit::format_value(set[key].get<double>(), 0) + " " + unit;
  }
  const std::string stated =
      text_of(bench.value("certificate", json::object()).value("environment", json::object()), key);
  return stated.empty() || !std::isdigit(static_cast<unsigned char>(stated.back())) ? stated
                                                                                    : stated + " " + unit;
}

}  // namespace

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

json identification(const SessionStore& session, const json& bench, const std::string& session_file) {
  const LidarIdentity lidar = lidar_of(session);
  const json stage = json_or_empty(session.get("stage"));
  const json stated = bench.value("certificate", json::object());
  json rows = json::array();
  add_row(rows, "Laboratory", text_of(stated, "laboratory"));
  add_row(rows, "Address", text_of(stated, "address"));
  add_row(rows, "Place of calibration", text_of(stated, "place"));
  add_row(rows, "Customer",
          join_nonempty({text_of(stated, "customer"), text_of(stated, "customer_address")}, ", "));
  // The device that was there; what the bench file calls it may be of another time.
  const std::string stated_model = lidar.product == lidar.model
                                       ? lidar.model
                                       : join_nonempty({lidar.product, lidar.model}, ", model "),
                    item = text_of(stated, "item");
  add_row(rows, "Item calibrated", stated_model.empty() ? item : stated_model);
  if (!stated_model.empty() && !item.empty() && item != stated_model)
    add_row(rows, "Item as the bench file calls it", item);
  add_row(rows, "Serial number", lidar.serial);
  add_row(rows, "Firmware", lidar.firmware);
  add_row(rows, "Received, condition",
          join_nonempty({text_of(stated, "received"), text_of(stated, "item_condition")}, ", "));
  add_row(rows, "Rotary stage",
          join_nonempty({text_of(stage, "model"), text_of(stage, "language"),
                         text_of(stage, "serial").empty() ? "" : "serial " + text_of(stage, "serial"),
                         text_of(stage, "firmware").empty() ? "" : "firmware " + text_of(stage, "firmware")},
                        ", "));
  std::string targets;
  for (const json& target : list_of(bench, "targets"))
    targets += (targets.empty() ? "" : ", ") + text_of(target, "name");
  add_row(rows, "Bench", text_of(bench, "name", targets.empty() ? "" : "targets: " + targets));
  add_row(rows, "Procedure", procedure_in_words(session));
  if (const std::string changed = changed_variables(session); !changed.empty())
    add_row(rows, "Variables changed", changed);
  add_row(rows, "Traceability", text_of(stated, "traceability"));
  add_row(rows, session_row, std::filesystem::path(session_file).filename().string());
  return rows;
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
  add_row(rows, "Measured", dates.measured());
  if (!dates.imported_utc.empty()) add_row(rows, "Imported", dates.imported_utc);
  add_row(rows, "Captures", std::to_string(recording.captures().size()));
  add_row(rows, "Time from first to last capture",
          started.empty() ? "" : duration_text(started.high - started.low));
  add_row(rows, "Stage angles", stage.text("deg", "%.2f"));
  add_row(rows, "Ambient temperature", environment(session, bench, "temperature_c", "\u00b0C"));
  add_row(rows, "Relative humidity", environment(session, bench, "humidity_percent", "%"));
  add_row(rows, "Illuminance", environment(session, bench, "illuminance_lux", "lx"));
  add_row(rows, "Temperature of the lidar's housing", temperature.text("\u00b0C"));
  add_row(rows, "Time since power-on", warm.text("min", "%.0f"));
  return rows;
}

}  // namespace rig
