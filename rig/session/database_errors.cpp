// SPDX-License-Identifier: MIT
#include "rig/session/database_errors.hpp"

#include <sqlite3.h>

#include "rig/errors.hpp"

namespace rig {

void tell_operator(const std::string& path, const SQLite::Exception& error) {
  switch (error.getErrorCode()) {
    case SQLITE_FULL:
      throw MeasurementError(
          "The disk is full: " + path +
          " cannot grow. What was captured before is intact. Free some space, then run again "
          "with --resume.");
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
      throw UsageError(path + " is damaged or not a session file (" + error.what() +
                       "). Nothing was changed. Copy it and try `sqlite3 FILE .recover`.");
    case SQLITE_BUSY:
      throw UsageError(path + " is being written by another program. Wait for it to finish or stop it.");
    case SQLITE_READONLY:
    case SQLITE_PERM:
      throw UsageError(path + " cannot be written. Check the permissions of the file and its folder.");
    case SQLITE_CANTOPEN:
      throw UsageError(path + " cannot be opened or made. Choose another folder or mend its permissions.");
    case SQLITE_IOERR:
      throw MeasurementError(
          "Reading or writing " + path + " failed (" + error.what() +
          "). What was captured before is intact. Check the disk, then run again with --resume.");
    default:
      throw MeasurementError(path + ": " + error.what());
  }
}

}  // namespace rig
