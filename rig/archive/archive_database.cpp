// SPDX-License-Identifier: MIT
#include "rig/archive/archive_database.hpp"

#include "rig/errors.hpp"

namespace rig {

namespace archive_databases {
std::vector<ArchiveDatabaseKind> all();
}

std::unique_ptr<ArchiveDatabase> open_archive_database(const std::string& location, bool to_write) {
  std::string names;
  for (const ArchiveDatabaseKind& kind : archive_databases::all()) {
    if (kind.takes(location)) return kind.open(location, to_write);
    names += (names.empty() ? "" : ", ") + kind.name;
  }
  throw UsageError("no database accepts the index '" + location + "' (there are: " + names + ")");
}

ArchiveTransaction::~ArchiveTransaction() {
  if (ended_) return;
  try {
    database_.run("ROLLBACK");
  } catch (const std::exception&) {
    // The database rolls back by itself when the connection ends.
  }
}

void ArchiveTransaction::commit() {
  database_.run("COMMIT");
  ended_ = true;
}

}  // namespace rig
