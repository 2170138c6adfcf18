// SPDX-License-Identifier: MIT
#include "rig/archive/session_record.hpp"

#include <sys/stat.h>

#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>

#include "fit/numeric/utf8.hpp"
#include "rig/errors.hpp"
#include "rig/json_fields.hpp"
#include "rig/session/lidar_identity.hpp"
#include "rig/session/session_dates.hpp"
#include "rig/session/session_store.hpp"
#include "rig/session/sha256.hpp"
#include "rig/session/standing.hpp"

namespace rig {
namespace {

using nlohmann::json;

constexpr std::size_t longest_text = 2000, most_entries = 2000;
constexpr int deepest_nesting = 64;

/// A document that a stranger may have written: nested so deeply that walking it would exhaust the stack, it
/// is none.
json document_in(const std::string& text) {
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      if (c == '"') in_string = false;
    } else if (c == '"') {
      in_string = true;
    } else if (c == '[' || c == '{') {
      if (++depth > deepest_nesting) return nullptr;
    } else if (c == ']' || c == '}') {
      --depth;
    }
  }
  json value = json::parse(text, nullptr, false, true);
  return value.is_discarded() ? json() : value;
}

/// Text as an index may hold it: UTF-8 without control characters, not too long.
std::string clean(const std::string& text) {
  std::string out;
  for (std::size_t i = 0; i < text.size() && out.size() < longest_text;) {
    const std::size_t length = fit::utf8_length(text, i);
    const auto c = static_cast<unsigned char>(text[i]);
    if (length == 0 || c < 0x20 || c == 0x7F)
      out += c == '\n' || c == '\t' ? ' ' : '?';
    else
      out.append(text, i, length);
    i += std::max<std::size_t>(length, 1);
  }
  return out;
}

std::string clean_at(const json& object, const char* key) { return clean(text_of(object, key)); }

double finite_or_zero(double value) { return std::isfinite(value) ? value : 0; }

void add_values(SessionRecord& record, const std::string& kind, const json& result) {
  for (const json& value : list_of(result, "values")) {
    const double number = number_of(value, "value");
    if (!std::isfinite(number) || record.values.size() >= most_entries) continue;
    ArchivedValue out{clean(kind),
                      clean_at(value, "name"),
                      clean_at(value, "label"),
                      clean_at(value, "unit"),
                      number,
                      0,
                      0};
    out.expanded = std::abs(finite_or_zero(expanded_of(value)));
    const double k = finite_or_zero(number_of(value, "k", 2));
    out.u = std::abs(finite_or_zero(number_of(value, "u", k > 0 ? out.expanded / k : out.expanded / 2)));
    if (out.label.empty()) out.label = out.name;
    record.values.push_back(std::move(out));
  }
}

void add_limits(SessionRecord& record, const json& result) {
  for (const json& check : list_of(result, "checks")) {
    ArchivedLimit limit{clean_at(check, "of"), clean_at(check, "verdict"), {}, {}};
    for (const auto& [key, place] : {std::pair{"min", &limit.min}, std::pair{"max", &limit.max}})
      if (const double number = number_of(check, key); std::isfinite(number)) *place = number;
    if (limit.quantity.empty() || record.limits.size() >= most_entries) continue;
    record.limits.push_back(std::move(limit));
  }
}

std::vector<double> numbers_of(const json& object, const char* key) {
  std::vector<double> out;
  for (const json& value : list_of(object, key))
    if (out.size() < most_entries) out.push_back(value.is_number() ? finite_or_zero(value.get<double>()) : 0);
  return out;
}

void add_unknown(ArchivedExplanation& out, const json& document) {
  const json unknown = document.value("unknown", json());
  if (!unknown.is_object() || is_bench_error(document)) return;
  out.unknown_coordinate = clean_at(unknown, "coordinate");
  out.unknown_observable = clean_at(unknown, "observable");
  out.unknown_describes = clean_at(unknown, "describes");
  for (const auto& [key, place] : {std::pair{"from", &out.unknown_from}, std::pair{"to", &out.unknown_to}})
    if (const double number = number_of(unknown, key); std::isfinite(number)) *place = number;
  for (const json& part : list_of(document, "empirical_correction")) {
    if (clean_at(part, "coordinate") != out.unknown_coordinate) continue;
    for (const char* channel : {"range_mm", "range_mm_per_m", "beam_angle_deg", "stage_angle_deg"}) {
      out.curve_at = numbers_of(part, "at");
      out.curve = numbers_of(part, channel);
      out.unknown_channel = channel;
      if (!out.curve.empty() && out.curve.size() == out.curve_at.size()) return;
    }
  }
  out.curve_at.clear();
  out.curve.clear();
  out.unknown_channel.clear();
}

/// What stands of the procedure, without the values that this run gave its variables.
void add_procedure(SessionRecord& record, const SessionStore& session) {
  record.kind = clean(session.get("kind").value_or(""));
  record.procedure = clean(session.get("procedure_name").value_or(session.get("kind").value_or("")));
  if (const auto text = session.get("procedure"); text && !text->empty())
    record.procedure_sha256 = sha256_of(*text);
}

void add_bench(SessionRecord& record, const SessionStore& session) {
  const std::string text = session.get("bench").value_or("");
  if (text.empty()) return;
  record.bench_sha256 = sha256_of(text);
  const json bench = document_in(text);
  if (!bench.is_object()) return;
  record.bench = clean_at(bench, "name");
  const json stated = bench.value("certificate", json::object());
  record.item_state = clean_at(stated, "item_state");
}

}  // namespace

std::string clean_text(const std::string& text) { return clean(text); }

bool is_clean(const std::string& text) { return clean(text) == text; }

std::optional<ArchivedExplanation> explanation_in(const std::string& text, const std::string& made_utc) {
  const json document = document_in(text);
  if (!document.is_object() || clean_at(document, "verdict").empty()) return std::nullopt;
  ArchivedExplanation out;
  out.verdict = clean_at(document, "verdict");
  out.made_utc = clean(made_utc);
  for (const json& found : list_of(document, "mechanisms")) {
    ArchivedMechanism mechanism{
        clean_at(found, "mechanism"), finite_or_zero(number_of(found, "probability")), {}};
    if (mechanism.mechanism.empty() || out.mechanisms.size() >= most_entries) continue;
    const json parameters = found.value("parameters", json::object());
    if (parameters.is_object())
      for (const auto& [name, p] : parameters.items())
        if (const double value = number_of(p, "value"); std::isfinite(value))
          mechanism.parameters[clean(name)] = {value, std::abs(finite_or_zero(number_of(p, "u")))};
    out.mechanisms.push_back(std::move(mechanism));
  }
  for (const json& set : list_of(document, "undecided_between")) {
    std::string words;
    if (set.is_array())
      for (const json& name : set)
        if (name.is_string()) words += (words.empty() ? "" : " or ") + clean(name.get<std::string>());
    if (!words.empty() && out.undecided.size() < most_entries) out.undecided.push_back(clean(words));
  }
  add_unknown(out, document);
  return out;
}

SessionRecord read_session_record(const std::string& folder, const std::string& path) {
  const std::string file = folder + "/" + path;
  SessionRecord record;
  record.path = path;
  const FileStamp stamp = file_stamp(file);
  record.bytes = stamp.bytes;
  record.modified_ns = stamp.modified_ns;
  record.file_sha256 = file_sha256(file);
  const SessionStore session(file, SessionStore::Mode::peek);
  record.content_sha256 = session.content_hash();
  record.measured_utc = clean(dates_of(session).measured_utc);
  record.software = clean(session.get("software").value_or(""));
  record.ended = clean(session.get("ended").value_or(""));
  const std::string lidar_text = session.get("lidar").value_or(""),
                    stage_text = session.get("stage").value_or("");
  const LidarIdentity lidar = lidar_in(document_in(lidar_text));
  record.model = clean(lidar.name());
  record.serial = clean(lidar.serial);
  record.firmware = clean(lidar.firmware);
  const json stage = document_in(stage_text);
  record.stage = clean_at(stage, "model");
  if (const std::string serial = clean_at(stage, "serial"); !serial.empty()) record.stage += " " + serial;
  record.simulated = says_simulated(lidar_text) || says_simulated(stage_text);
  add_procedure(record, session);
  add_bench(record, session);
  record.captures = session.count_captures();
  record.scans = session.count_scans();
  for (const SessionStore::Result& result : session.latest_results()) {
    if (result.kind == "explanation" || result.kind == "explain") {
      record.explanation = explanation_in(result.json, result.created_utc);
      continue;
    }
    const json document = document_in(result.json);
    result.kind == "limits" ? add_limits(record, document) : add_values(record, result.kind, document);
  }
  if (file_stamp(file) != stamp)
    throw MeasurementError(path +
                           " changed while it was read: it is being written. Add it when its run has ended.");
  return record;
}

std::string file_sha256(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw UsageError(path + " cannot be read. Check its name and permissions.");
  Sha256 hash;
  std::vector<char> piece(1 << 20);
  while (file) {
    file.read(piece.data(), static_cast<std::streamsize>(piece.size()));
    hash.feed(piece.data(), static_cast<std::size_t>(file.gcount()));
  }
  if (file.bad()) throw UsageError(path + " cannot be read to its end: the disk reports an error.");
  return hash.hex();
}

FileStamp file_stamp(const std::string& path) {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0) throw UsageError(path + ": there is no such file.");
  return {found.st_size, std::int64_t{found.st_mtim.tv_sec} * 1'000'000'000 + found.st_mtim.tv_nsec};
}

std::optional<double> seconds_of_utc(const std::string& utc) {
  std::tm t{};
  if (std::sscanf(utc.c_str(), "%4d-%2d-%2dT%2d:%2d:%2d", &t.tm_year, &t.tm_mon, &t.tm_mday, &t.tm_hour,
                  &t.tm_min, &t.tm_sec) != 6)
    return std::nullopt;
  if (t.tm_year < 1900 || t.tm_mon < 1 || t.tm_mon > 12 || t.tm_mday < 1 || t.tm_mday > 31)
    return std::nullopt;
  t.tm_year -= 1900;
  t.tm_mon -= 1;
  return static_cast<double>(::timegm(&t));
}

}  // namespace rig
