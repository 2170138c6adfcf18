// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace rig {

/// The database that holds an archive's index. Values pass as text, nothing is NULL: columns have types that
/// SQLite and PostgreSQL both know (TEXT, BIGINT, DOUBLE PRECISION), and either converts by them.
/// Placeholders are $1, $2,
/// ... in this order. Errors of the database are MeasurementError, in its own words.
class ArchiveDatabase {
 public:
  using Value = std::optional<std::string>;
  using Row = std::vector<Value>;

  virtual ~ArchiveDatabase() = default;
  /// One statement; its rows.
  virtual std::vector<Row> run(const std::string& statement, const Row& values = {}) = 0;
  [[nodiscard]] virtual bool has_table(const std::string& name) = 0;
};

/// A kind of database. Each lives in its own file databases/NAME.cpp, which defines
/// `rig::ArchiveDatabaseKind rig::archive_databases::make_NAME()`; the build finds it by its name.
struct ArchiveDatabaseKind {
  std::string name;
  /// Whether a location is one of its own. That of files takes what no other takes.
  bool (*takes)(const std::string& location);
  /// To read, nothing is changed or made. Throws UsageError: there is none, or it cannot be reached.
  std::unique_ptr<ArchiveDatabase> (*open)(const std::string& location, bool to_write);
};

/// `location`: a file, or `postgresql://...` as libpq reads it. Throws UsageError.
[[nodiscard]] std::unique_ptr<ArchiveDatabase> open_archive_database(const std::string& location,
                                                                     bool to_write);

/// Everything between its making and commit() is done together or not at all.
class ArchiveTransaction {
 public:
  explicit ArchiveTransaction(ArchiveDatabase& database) : database_(database) { database_.run("BEGIN"); }
  ~ArchiveTransaction();
  ArchiveTransaction(const ArchiveTransaction&) = delete;
  ArchiveTransaction& operator=(const ArchiveTransaction&) = delete;
  void commit();

 private:
  ArchiveDatabase& database_;
  bool ended_ = false;
};

}  // namespace rig
