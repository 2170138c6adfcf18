// SPDX-License-Identifier: MIT
#include "rig/session/session_schema.hpp"

#include "rig/errors.hpp"
#include "rig/output_place.hpp"
#include "rig/session/utc.hpp"

namespace rig {
namespace {

constexpr int schema_version = 1;
// A scan of 1081 ranges and intensities (4324 bytes) then lies whole in one page: WITHOUT ROWID tables move
// rows above about an eighth of a page to overflow chains, which halves the reading speed.
constexpr int page_bytes = 32768;

constexpr const char* schema = R"(
CREATE TABLE session(key TEXT PRIMARY KEY, value TEXT);
CREATE TABLE capture(
  id INTEGER PRIMARY KEY,
  step TEXT,
  started_us INTEGER NOT NULL,
  stage_deg REAL NOT NULL,
  stage_readback_deg REAL,
  approach INTEGER NOT NULL,
  target TEXT,
  target_shift_mm REAL NOT NULL DEFAULT 0,
  reflectance REAL,
  temperature_c REAL,
  since_power_on_s REAL,
  stage_rate_deg_s REAL NOT NULL DEFAULT 0,
  first_step INTEGER NOT NULL, last_step INTEGER NOT NULL, cluster INTEGER NOT NULL DEFAULT 1
);
CREATE TABLE scan(
  capture INTEGER NOT NULL REFERENCES capture(id), seq INTEGER NOT NULL,
  device_ms INTEGER NOT NULL,
  host_us INTEGER NOT NULL,
  range_mm BLOB NOT NULL,
  intensity BLOB,
  PRIMARY KEY(capture, seq)) WITHOUT ROWID;
CREATE TABLE pose(host_us INTEGER NOT NULL, x_mm REAL, y_mm REAL, heading_deg REAL,
  wheel_left_rad REAL, wheel_right_rad REAL, stage_deg REAL);
CREATE TABLE result(kind TEXT, created_utc TEXT, json TEXT);
CREATE TABLE event(host_us INTEGER, level TEXT, text TEXT);
CREATE TABLE scan_geometry(capture INTEGER, seq INTEGER, first_deg REAL NOT NULL, step_deg REAL NOT NULL, scan_s REAL,
  PRIMARY KEY(capture, seq)) WITHOUT ROWID;
CREATE TABLE progress(step TEXT PRIMARY KEY, json TEXT);
)";

}  // namespace

void make_schema(SQLite::Database& database) {
  database.exec("PRAGMA page_size = " + std::to_string(page_bytes));
  database.exec("PRAGMA synchronous = FULL");
  SQLite::Transaction transaction(database);
  database.exec("PRAGMA application_id = " + std::to_string(session_application_id));
  database.exec("PRAGMA user_version = " + std::to_string(schema_version));
  database.exec(schema);
  put_key(database, "created_utc", utc_text(std::time(nullptr)));
  put_key(database, "software", "rig " RIG_VERSION);
  transaction.commit();
}

void complete_schema(SQLite::Database& database) {
  database.exec("CREATE TABLE IF NOT EXISTS progress(step TEXT PRIMARY KEY, json TEXT)");
  database.exec(
      "CREATE TABLE IF NOT EXISTS scan_geometry(capture INTEGER, seq INTEGER, first_deg REAL NOT NULL,"
      " step_deg REAL NOT NULL, scan_s REAL, PRIMARY KEY(capture, seq)) WITHOUT ROWID");
}

void check_identity(SQLite::Database& database, const std::string& path) {
  const int application = database.execAndGet("PRAGMA application_id").getInt();
  const int version = database.execAndGet("PRAGMA user_version").getInt();
  if (application != static_cast<int>(session_application_id))
    throw UsageError(path + " is an SQLite database but not a session file of rig (application id " +
                     std::to_string(application) + "). Use `rig import` for other tools' recordings.");
  if (version > schema_version)
    throw UsageError(path + " was written by a later version of rig (format " + std::to_string(version) +
                     ", this one reads up to " + std::to_string(schema_version) +
                     "). Update rig to read it.");
}

void check_tables(SQLite::Database& database, const std::string& path) {
  if (!database.tableExists("session") || !database.tableExists("capture") || !database.tableExists("scan"))
    throw UsageError(path + " lacks the tables of a session file. It is damaged or was never finished.");
}

void put_key(SQLite::Database& database, const std::string& key, const std::string& value) {
  SQLite::Statement statement(database, "INSERT OR REPLACE INTO session(key, value) VALUES(?, ?)");
  statement.bind(1, key);
  statement.bind(2, value);
  statement.exec();
}

}  // namespace rig
