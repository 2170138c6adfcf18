// SPDX-License-Identifier: MIT
// SHA-256 over what was measured: the name of the data on certificates.
#include <SQLiteCpp/SQLiteCpp.h>
#include <sqlite3.h>

#include <bit>

#include "rig/session/database_errors.hpp"
#include "rig/session/session_store_impl.hpp"
#include "rig/session/sha256.hpp"
#include "rig/session/stored_recording.hpp"

namespace rig {
namespace {

void feed_number(Sha256& hash, std::int64_t value) {
  std::uint8_t bytes[8];
  for (int i = 0; i < 8; ++i)
    bytes[i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i));
  hash.feed(bytes, sizeof bytes);
}

void feed_column(Sha256& hash, const SQLite::Column& column) {
  feed_number(hash, column.getType());
  switch (column.getType()) {
    case SQLITE_INTEGER:
      return feed_number(hash, column.getInt64());
    case SQLITE_FLOAT:
      return feed_number(hash, std::bit_cast<std::int64_t>(column.getDouble()));
    case SQLITE_NULL:
      return;
    default:
      feed_number(hash, column.getBytes());
      return hash.feed(column.getBlob(), static_cast<std::size_t>(column.getBytes()));
  }
}

void feed_rows(Sha256& hash, SQLite::Database& database, const std::string& table, const std::string& query) {
  hash.feed(table);
  if (!database.tableExists(table)) return;
  SQLite::Statement row(database, query);
  while (row.executeStep())
    for (int i = 0; i < row.getColumnCount(); ++i) feed_column(hash, row.getColumn(i));
}

}  // namespace

std::string SessionStore::content_hash() const {
  return guarded(impl_->path, [&] {
    if (impl_->writes() && !impl_->open_capture) impl_->flush();
    Sha256 hash;
    feed_rows(hash, *impl_->database, "session", "SELECT value FROM session WHERE key = 'bench'");
    feed_rows(hash, *impl_->database, "capture", select_captures);
    feed_rows(hash, *impl_->database, "scan",
              "SELECT capture, seq, device_ms, host_us, range_mm, intensity FROM scan ORDER BY capture, seq");
    feed_rows(hash, *impl_->database, "scan_geometry",
              "SELECT capture, seq, first_deg, step_deg, scan_s FROM scan_geometry ORDER BY capture, seq");
    feed_rows(hash, *impl_->database, "pose",
              "SELECT host_us, x_mm, y_mm, heading_deg, wheel_left_rad, wheel_right_rad, stage_deg FROM pose"
              " ORDER BY rowid");
    return hash.hex();
  });
}

}  // namespace rig
