// SPDX-License-Identifier: MIT
// A file beside the sessions: needs no server, and is read from read-only media too.
#include <SQLiteCpp/SQLiteCpp.h>
#include <sqlite3.h>

#include <filesystem>
#include <unordered_map>

#include "rig/archive/archive_database.hpp"
#include "rig/errors.hpp"
#include "rig/session/session_file.hpp"

namespace rig {
namespace {

constexpr int patience_ms = 10'000;  // Another `rig archive add` is at work: it takes seconds.

/// What to do about it; empty where the database's own words must do.
std::string advice_on(const SQLite::Exception& error) {
  switch (error.getErrorCode()) {
    case SQLITE_CANTOPEN:
    case SQLITE_READONLY:
    case SQLITE_PERM:
      return ". Check that its folder exists, and that you may write the folder and the file.";
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
      return ". It is damaged or no index: move it away, and `rig archive add FOLDER` rebuilds it from the "
             "sessions.";
    default:
      return "";
  }
}

class SqliteArchive final : public ArchiveDatabase {
 public:
  SqliteArchive(const std::string& path, bool to_write) : path_(path) {
    try {
      if (to_write) {
        database_ = std::make_unique<SQLite::Database>(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE,
                                                       patience_ms);
      } else if (std::filesystem::is_regular_file(path)) {
        database_ = open_for_reading(path);
      } else {
        throw UsageError(path + ": there is no archive index. `rig archive add FOLDER` makes it.");
      }
      database_->exec("PRAGMA trusted_schema = OFF");
    } catch (const SQLite::Exception& error) {
      throw UsageError(path + " cannot be opened as an archive's index: " + error.what() + advice_on(error));
    }
  }

  std::vector<Row> run(const std::string& statement, const Row& values) override {
    try {
      SQLite::Statement& prepared = prepared_statement(statement);
      prepared.reset();
      for (std::size_t i = 0; i < values.size(); ++i) {
        const int at = static_cast<int>(i) + 1;
        values[i] ? prepared.bind(at, *values[i]) : prepared.bind(at);
      }
      std::vector<Row> rows;
      while (prepared.executeStep()) {
        Row& row = rows.emplace_back();
        for (int i = 0; i < prepared.getColumnCount(); ++i) {
          const SQLite::Column column = prepared.getColumn(i);
          row.push_back(column.isNull() ? Value() : Value(column.getString()));
        }
      }
      prepared.reset();
      return rows;
    } catch (const SQLite::Exception& error) {
      throw MeasurementError("the archive's index " + path_ + ": " + error.what() + advice_on(error));
    }
  }

  bool has_table(const std::string& name) override {
    return !run("SELECT 1 FROM sqlite_schema WHERE type = 'table' AND name = $1", {name}).empty();
  }

 private:
  SQLite::Statement& prepared_statement(const std::string& text) {
    const auto known = prepared_.find(text);
    if (known != prepared_.end()) return known->second;
    return prepared_
        .emplace(std::piecewise_construct, std::forward_as_tuple(text),
                 std::forward_as_tuple(*database_, text))
        .first->second;
  }

  std::string path_;
  std::unique_ptr<SQLite::Database> database_;
  std::unordered_map<std::string, SQLite::Statement> prepared_;
};

}  // namespace

namespace archive_databases {

ArchiveDatabaseKind make_sqlite() {
  return {"file", [](const std::string& location) { return location.find("://") == std::string::npos; },
          [](const std::string& location, bool to_write) -> std::unique_ptr<ArchiveDatabase> {
            return std::make_unique<SqliteArchive>(location, to_write);
          }};
}

}  // namespace archive_databases
}  // namespace rig
