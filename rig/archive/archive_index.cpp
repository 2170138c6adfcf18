// SPDX-License-Identifier: MIT
#include "rig/archive/archive_index.hpp"

#include <array>
#include <charconv>
#include <nlohmann/json.hpp>
#include <unordered_map>

#include "rig/errors.hpp"

namespace rig {
namespace {

using nlohmann::json;
using Row = ArchiveDatabase::Row;

constexpr const char* index_version = "1";

constexpr std::array tables = {
    "CREATE TABLE archive(key TEXT PRIMARY KEY, value TEXT)",
    "CREATE TABLE session(content_sha256 TEXT PRIMARY KEY, path TEXT UNIQUE, bytes BIGINT, modified_ns "
    "BIGINT,"
    " file_sha256 TEXT, measured_utc TEXT, software TEXT, kind TEXT, procedure_name TEXT, procedure_sha256 "
    "TEXT,"
    " bench TEXT, bench_sha256 TEXT, lidar_model TEXT, lidar_serial TEXT, lidar_firmware TEXT, stage TEXT, "
    "ended TEXT,"
    " item_state TEXT, simulated BIGINT, captures BIGINT, scans BIGINT)",
    "CREATE INDEX session_of_lidar ON session(lidar_serial, measured_utc)",
    "CREATE TABLE result_value(session TEXT, at BIGINT, kind TEXT, name TEXT, label TEXT, unit TEXT,"
    " value DOUBLE PRECISION, u DOUBLE PRECISION, expanded DOUBLE PRECISION, PRIMARY KEY(session, at))",
    "CREATE TABLE requirement(session TEXT, at BIGINT, quantity TEXT, verdict TEXT, least DOUBLE PRECISION,"
    " most DOUBLE PRECISION, PRIMARY KEY(session, at))",
    "CREATE TABLE explanation(session TEXT PRIMARY KEY, verdict TEXT, made_utc TEXT, undecided TEXT,"
    " unknown_coordinate TEXT, unknown_observable TEXT, unknown_describes TEXT, unknown_from DOUBLE "
    "PRECISION,"
    " unknown_to DOUBLE PRECISION, unknown_channel TEXT, unknown_curve TEXT)",
    "CREATE TABLE mechanism(session TEXT, at BIGINT, mechanism TEXT, probability DOUBLE PRECISION, PRIMARY "
    "KEY(session, at))",
    "CREATE TABLE mechanism_parameter(session TEXT, at BIGINT, name TEXT, value DOUBLE PRECISION, u DOUBLE "
    "PRECISION,"
    " PRIMARY KEY(session, at, name))"};

constexpr std::array parts = {"result_value", "requirement", "explanation", "mechanism",
                              "mechanism_parameter"};

constexpr const char* session_columns =
    "content_sha256, path, bytes, modified_ns, file_sha256, measured_utc, software, kind, procedure_name,"
    " procedure_sha256, bench, bench_sha256, lidar_model, lidar_serial, lidar_firmware, stage, ended, "
    "item_state,"
    " simulated, captures, scans";

std::string text_of_number(double value) {
  std::array<char, 40> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  return {text.data(), end};
}

ArchiveDatabase::Value text_of_number(const std::optional<double>& value) {
  return value ? ArchiveDatabase::Value(text_of_number(*value)) : std::nullopt;
}

std::string raw_text_at(const Row& row, std::size_t at) {
  return at < row.size() ? row[at].value_or("") : "";
}

/// The index too may be a stranger's.
std::string text_at(const Row& row, std::size_t at) { return clean_text(raw_text_at(row, at)); }

template <class T>
T number_at(const Row& row, std::size_t at) {
  const std::string text = text_at(row, at);
  T value{};
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

std::optional<double> maybe_number_at(const Row& row, std::size_t at) {
  return at < row.size() && row[at] ? std::optional(number_at<double>(row, at)) : std::nullopt;
}

SessionRecord record_of(const Row& row) {
  SessionRecord r;
  std::size_t at = 0;
  r.content_sha256 = text_at(row, at++);
  r.path = text_at(row, at++);
  r.bytes = number_at<std::int64_t>(row, at++);
  r.modified_ns = number_at<std::int64_t>(row, at++);
  for (std::string* text :
       {&r.file_sha256, &r.measured_utc, &r.software, &r.kind, &r.procedure, &r.procedure_sha256, &r.bench,
        &r.bench_sha256, &r.model, &r.serial, &r.firmware, &r.stage, &r.ended, &r.item_state})
    *text = text_at(row, at++);
  r.simulated = number_at<std::int64_t>(row, at++) != 0;
  r.captures = number_at<std::int64_t>(row, at++);
  r.scans = number_at<std::int64_t>(row, at++);
  return r;
}

std::string curve_text(const ArchivedExplanation& e) {
  return e.curve.empty() ? "" : json{{"at", e.curve_at}, {"values", e.curve}}.dump();
}

void read_curve(ArchivedExplanation& e, const std::string& text) {
  const json curve = json::parse(text, nullptr, false);
  if (!curve.is_object()) return;
  for (const auto& [key, to] : {std::pair{"at", &e.curve_at}, std::pair{"values", &e.curve}})
    if (curve.contains(key) && curve[key].is_array())
      for (const json& value : curve[key])
        if (value.is_number()) to->push_back(value.get<double>());
}

std::string joined(const std::vector<std::string>& words) {
  std::string out;
  for (const std::string& word : words) out += (out.empty() ? "" : "; ") + word;
  return out;
}

std::vector<std::string> parted(const std::string& text) {
  std::vector<std::string> out;
  for (std::size_t from = 0; from < text.size();) {
    const std::size_t end = std::min(text.find("; ", from), text.size());
    out.push_back(text.substr(from, end - from));
    from = end + 2;
  }
  return out;
}

}  // namespace

std::string index_location(const std::string& folder, const std::string& index) {
  return index.empty() ? folder + "/archive-index.sqlite" : index;
}

ArchiveIndex::ArchiveIndex(const std::string& location, bool to_write)
    : database_(open_archive_database(location, to_write)) {
  if (!database_->has_table("archive")) {
    if (!to_write)
      throw UsageError(location + ": there is no archive index. `rig archive add FOLDER` makes it.");
    make_tables();
  }
  for (const char* table :
       {"session", "result_value", "requirement", "explanation", "mechanism", "mechanism_parameter"})
    if (!database_->has_table(table))
      throw UsageError(location + " is not an archive index: it has no table '" + table +
                       "'. Remove it: `rig archive add FOLDER` rebuilds it from the sessions.");
  const auto version = database_->run("SELECT value FROM archive WHERE key = 'version'");
  if (version.empty() || text_at(version.front(), 0) != index_version)
    throw UsageError(location +
                     " is an index of another version of rig. Remove it: `rig archive add FOLDER` rebuilds "
                     "it from the sessions.");
}

void ArchiveIndex::make_tables() {
  ArchiveTransaction transaction(*database_);
  for (const char* table : tables) database_->run(table);
  database_->run("INSERT INTO archive VALUES('version', $1)", {index_version});
  transaction.commit();
}

void ArchiveIndex::forget(const std::string& content) {
  for (const char* part : parts)
    database_->run(std::string("DELETE FROM ") + part + " WHERE session = $1", {content});
  database_->run("DELETE FROM session WHERE content_sha256 = $1", {content});
}

void ArchiveIndex::forget_all() {
  for (const char* part : parts) database_->run(std::string("DELETE FROM ") + part);
  database_->run("DELETE FROM session");
}

void ArchiveIndex::set_path(const std::string& content, const std::string& path) {
  database_->run("UPDATE session SET path = $1 WHERE content_sha256 = $2", {path, content});
}

void ArchiveIndex::put(const SessionRecord& r) {
  for (const Row& row :
       database_->run("SELECT content_sha256 FROM session WHERE content_sha256 = $1 OR path = $2",
                      {r.content_sha256, r.path}))
    forget(text_at(row, 0));
  database_->run(std::string("INSERT INTO session(") + session_columns +
                     ") VALUES($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, $17, "
                     "$18, $19, $20, $21)",
                 {r.content_sha256,
                  r.path,
                  std::to_string(r.bytes),
                  std::to_string(r.modified_ns),
                  r.file_sha256,
                  r.measured_utc,
                  r.software,
                  r.kind,
                  r.procedure,
                  r.procedure_sha256,
                  r.bench,
                  r.bench_sha256,
                  r.model,
                  r.serial,
                  r.firmware,
                  r.stage,
                  r.ended,
                  r.item_state,
                  r.simulated ? "1" : "0",
                  std::to_string(r.captures),
                  std::to_string(r.scans)});
  for (std::size_t i = 0; i < r.values.size(); ++i) {
    const ArchivedValue& v = r.values[i];
    database_->run("INSERT INTO result_value VALUES($1, $2, $3, $4, $5, $6, $7, $8, $9)",
                   {r.content_sha256, std::to_string(i), v.kind, v.name, v.label, v.unit,
                    text_of_number(v.value), text_of_number(v.u), text_of_number(v.expanded)});
  }
  for (std::size_t i = 0; i < r.limits.size(); ++i) {
    const ArchivedLimit& l = r.limits[i];
    database_->run("INSERT INTO requirement VALUES($1, $2, $3, $4, $5, $6)",
                   {r.content_sha256, std::to_string(i), l.quantity, l.verdict, text_of_number(l.min),
                    text_of_number(l.max)});
  }
  if (r.explanation) put_explanation(r.content_sha256, *r.explanation);
}

void ArchiveIndex::put_explanation(const std::string& session, const ArchivedExplanation& e) {
  database_->run("INSERT INTO explanation VALUES($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11)",
                 {session, e.verdict, e.made_utc, joined(e.undecided), e.unknown_coordinate,
                  e.unknown_observable, e.unknown_describes, text_of_number(e.unknown_from),
                  text_of_number(e.unknown_to), e.unknown_channel, curve_text(e)});
  for (std::size_t i = 0; i < e.mechanisms.size(); ++i) {
    const ArchivedMechanism& m = e.mechanisms[i];
    database_->run("INSERT INTO mechanism VALUES($1, $2, $3, $4)",
                   {session, std::to_string(i), m.mechanism, text_of_number(m.probability)});
    for (const auto& [name, p] : m.parameters)
      database_->run("INSERT INTO mechanism_parameter VALUES($1, $2, $3, $4, $5)",
                     {session, std::to_string(i), name, text_of_number(p.value), text_of_number(p.u)});
  }
}

std::vector<SessionRecord> ArchiveIndex::files() {
  std::vector<SessionRecord> all;
  for (const Row& row :
       database_->run(std::string("SELECT ") + session_columns + " FROM session ORDER BY path"))
    all.push_back(record_of(row));
  return all;
}

std::vector<SessionRecord> ArchiveIndex::sessions() {
  std::vector<SessionRecord> all;
  std::unordered_map<std::string, std::size_t> place;
  for (const Row& row : database_->run(std::string("SELECT ") + session_columns +
                                       " FROM session ORDER BY lidar_serial, measured_utc, content_sha256")) {
    place[text_at(row, 0)] = all.size();
    all.push_back(record_of(row));
  }
  const auto record = [&](const Row& row) -> SessionRecord* {
    const auto found = place.find(text_at(row, 0));
    return found == place.end() ? nullptr : &all[found->second];
  };
  for (const Row& row :
       database_->run("SELECT session, kind, name, label, unit, value, u, expanded FROM result_value"
                      " ORDER BY session, at"))
    if (SessionRecord* r = record(row))
      r->values.push_back({text_at(row, 1), text_at(row, 2), text_at(row, 3), text_at(row, 4),
                           number_at<double>(row, 5), number_at<double>(row, 6), number_at<double>(row, 7)});
  for (const Row& row :
       database_->run("SELECT session, quantity, verdict, least, most FROM requirement ORDER BY session, at"))
    if (SessionRecord* r = record(row))
      r->limits.push_back(
          {text_at(row, 1), text_at(row, 2), maybe_number_at(row, 3), maybe_number_at(row, 4)});
  for (const Row& row : database_->run(
           "SELECT session, verdict, made_utc, undecided, unknown_coordinate, unknown_observable,"
           " unknown_describes, unknown_from, unknown_to, unknown_channel, unknown_curve FROM explanation")) {
    SessionRecord* r = record(row);
    if (!r) continue;
    ArchivedExplanation e;
    e.verdict = text_at(row, 1);
    e.made_utc = text_at(row, 2);
    e.undecided = parted(text_at(row, 3));
    e.unknown_coordinate = text_at(row, 4);
    e.unknown_observable = text_at(row, 5);
    e.unknown_describes = text_at(row, 6);
    e.unknown_from = maybe_number_at(row, 7);
    e.unknown_to = maybe_number_at(row, 8);
    e.unknown_channel = text_at(row, 9);
    read_curve(e, raw_text_at(row, 10));
    r->explanation = std::move(e);
  }
  for (const Row& row :
       database_->run("SELECT session, mechanism, probability FROM mechanism ORDER BY session, at"))
    if (SessionRecord* r = record(row); r && r->explanation)
      r->explanation->mechanisms.push_back({text_at(row, 1), number_at<double>(row, 2), {}});
  for (const Row& row : database_->run("SELECT session, at, name, value, u FROM mechanism_parameter"))
    if (SessionRecord* r = record(row); r && r->explanation)
      if (const auto at = number_at<std::size_t>(row, 1); at < r->explanation->mechanisms.size())
        r->explanation->mechanisms[at].parameters[text_at(row, 2)] = {number_at<double>(row, 3),
                                                                      number_at<double>(row, 4)};
  return all;
}

}  // namespace rig
