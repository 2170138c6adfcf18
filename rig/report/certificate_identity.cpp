// SPDX-License-Identifier: MIT
#include "rig/report/certificate_identity.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <vector>

#include "fit/numeric/number_format.hpp"
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

/// What follows the first of these words that begins a line. Procedures may be a stranger's and of any
/// length, for which a regular expression needs too much stack.
std::optional<std::string_view> after_line_start(std::string_view text, std::string_view word) {
  for (std::size_t at = text.find(word); at != std::string_view::npos; at = text.find(word, at + 1))
    if (at == 0 || text[at - 1] == '\n') return text.substr(at + word.size());
  return std::nullopt;
}

/// The variables that the procedure states on one line, as written.
std::map<std::string, std::string> stated_variables(std::string_view procedure) {
  std::map<std::string, std::string> all;
  const auto rest = after_line_start(procedure, "variables:");
  const std::size_t open = rest ? rest->find_first_not_of(" \t\r\n") : std::string_view::npos;
  if (open == std::string_view::npos || (*rest)[open] != '{') return all;
  const std::size_t close = rest->find('}', open);
  if (close == std::string_view::npos) return all;
  const std::string_view block = rest->substr(open + 1, close - open - 1);
  for (const std::string_view entry : split(block, ',')) {
    const std::size_t colon = entry.find(':');
    if (colon == std::string_view::npos) continue;
    const std::string_view blanks = " \t\r\n";
    std::string_view name = entry.substr(0, colon);
    name.remove_prefix(std::min(name.size(), name.find_first_not_of(blanks)));
    std::string_view value = entry.substr(colon + 1);
    while (!value.empty() && blanks.find(value.back()) != std::string_view::npos) value.remove_suffix(1);
    all.emplace(name, trimmed(value));
  }
  return all;
}

/// Variables that the run was given other values than the procedure's.
std::string changed_variables(const SessionStore& session) {
  const json used = json_or_empty(session.get("variables"));
  const std::string text = session.get("procedure").value_or("");
  const auto stated = stated_variables(text);
  if (!used.is_object() || used.empty() || stated.empty()) return "";
  std::string out;
  for (const auto& [name, value] : used.items()) {
    const auto found = stated.find(name);
    if (found == stated.end()) continue;
    const std::string& was = found->second;
    const std::string is = value.is_string() ? value.get<std::string>() : value.dump();
    const bool same =
        value.is_number() ? std::strtod(was.c_str(), nullptr) == value.get<double>() : was == is;
    if (!same)
      out += (out.empty() ? "" : ", ") + name + " = " +
             (value.is_number() ? fit::format_value(value.get<double>(), 0) : is) + " (procedure: " + was +
             ")";
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
  std::string version;
  if (const auto rest = after_line_start(text, "version:")) {
    const std::size_t from = rest->find_first_not_of(" \t\r\n\"'");
    if (from != std::string_view::npos)
      version = trimmed(rest->substr(from, rest->find_first_of("\"'\n#", from) - from));
  }
  return join_nonempty(
      {name, version.empty() ? "" : "version " + version, "SHA-256 " + hash.hex().substr(0, 16)}, ", ");
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
