// SPDX-License-Identifier: MIT
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <memory>
#include <string>

namespace rig {

/// Holds an advisory lock for as long as the writer lives, so that a second `rig run` on the same file is
/// refused (UsageError). SQLite's own locks are per transaction only.
class WriterLock {
 public:
  explicit WriterLock(const std::string& path);
  ~WriterLock();
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

  /// Whether the file still has its name: it may have been removed or replaced meanwhile.
  [[nodiscard]] bool names(const std::string& path) const;

 private:
  int fd_;
};

/// Whether there is a file of more than no bytes.
[[nodiscard]] bool has_data(const std::string& path);

/// Makes a session whose writer was killed one file again: takes what its write-ahead log holds into it and
/// removes the log. Does nothing while a writer is there, or where the file cannot be written.
void fold_log(const std::string& path);

/// What a person should know of a session that has a write-ahead log beside it, or lacks one that it had;
/// empty if it is one plain file.
[[nodiscard]] std::string words_about_log(const std::string& path);

/// Opens a session, or what should be one, for reading: beside a writer, after a crash, and on read-only
/// media too. Throws UsageError or SQLite::Exception.
[[nodiscard]] std::unique_ptr<SQLite::Database> open_for_reading(const std::string& path);

/// Opens a finished session, perhaps a stranger's, so that nothing on the disk changes. Throws UsageError
/// (there is a log beside it; a table is none) or SQLite::Exception.
[[nodiscard]] std::unique_ptr<SQLite::Database> open_untouched(const std::string& path);

/// Whether some program of this computer writes the session now, by the locks that the system lists.
[[nodiscard]] bool is_being_written(const std::string& path);

}  // namespace rig
