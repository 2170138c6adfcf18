// SPDX-License-Identifier: MIT
#include "rig/session/database_errors.hpp"

#include <sqlite3.h>

#include <algorithm>
#include <fstream>

#include "rig/output_place.hpp"

namespace rig {
namespace {

/// A bench, a procedure or a table that was given for a session: it begins with characters that people read.
bool is_text(const std::string& path) {
  std::string head(512, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(file.gcount()));
  return !head.empty() && std::ranges::none_of(head, [](char c) {
    const auto code = static_cast<unsigned char>(c);
    return code == 0x7F || (code < 0x20 && c != '\n' && c != '\r' && c != '\t');
  });
}

}  // namespace

void rethrow_for_operator(const std::string& path, const SQLite::Exception& error) {
  switch (error.getErrorCode()) {
    case SQLITE_FULL:
      throw SessionDiskError("The disk is full: " + path +
                             " cannot grow. What it held before is intact. Free some space and try again; a "
                             "run continues with rig resume.");
    case SQLITE_NOTADB:
      if (is_text(path))
        throw UsageError(path +
                         " is a text file, not a session file. Give the *.rig that `rig run` or `rig import` "
                         "wrote.");
      [[fallthrough]];
    case SQLITE_CORRUPT:
      throw UsageError(
          path + " is damaged or not a session file (" + error.what() +
          "). Nothing was changed. Take it from the archive or another copy. Where there is none, this saves "
          "what "
          "can still be reached, to be read but not resumed: (echo 'PRAGMA application_id=" +
          std::to_string(session_application_id) +
          ";'; sqlite3 -readonly FILE .dump | sed 's/^ROLLBACK.*/COMMIT;/') | sqlite3 SAVED.rig");
    case SQLITE_BUSY:
      throw UsageError(path + " is being written by another program. Wait for it to finish or stop it.");
    case SQLITE_READONLY:
    case SQLITE_PERM:
      throw UsageError(path + " cannot be written. Check the permissions of the file and its folder.");
    case SQLITE_CANTOPEN:
      throw UsageError(path + " cannot be opened or made. Choose another folder or correct its permissions.");
    case SQLITE_IOERR:
      throw SessionDiskError("Reading or writing " + path + " failed (" + error.what() +
                             "). What it held before is intact. Check the disk and try again; a run "
                             "continues with rig resume.");
    default:
      throw MeasurementError(path + ": " + error.what());
  }
}

}  // namespace rig
