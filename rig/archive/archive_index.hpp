// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "rig/archive/archive_database.hpp"
#include "rig/archive/session_record.hpp"

namespace rig {

/// The index of an archive: what its sessions hold, in tables that any client of the database reads
/// (docs/operate/laboratory.md). Nothing is in it that the sessions do not say: it can be made anew at any
/// time.
class ArchiveIndex {
 public:
  /// To read, or to write, which makes the tables if there are none. Throws UsageError (no index there; one
  /// of a later version).
  ArchiveIndex(const std::string& location, bool to_write);

  /// Takes a session in, in place of what is known of the same content or of the same path.
  void put(const SessionRecord& record);
  void set_path(const std::string& content_sha256, const std::string& path);
  void forget(const std::string& content_sha256);
  void forget_all();

  /// Every session, by serial number and date.
  [[nodiscard]] std::vector<SessionRecord> sessions();
  /// What tells whether a file is the one that was taken in; all else of the record is empty.
  [[nodiscard]] std::vector<SessionRecord> files();

  [[nodiscard]] ArchiveDatabase& database() { return *database_; }

 private:
  void make_tables();
  void put_explanation(const std::string& session, const ArchivedExplanation& explanation);

  std::unique_ptr<ArchiveDatabase> database_;
};

/// Where the index of the archive in `folder` is: `index` if given, else a file in the folder.
[[nodiscard]] std::string index_location(const std::string& folder, const std::string& index);

}  // namespace rig
