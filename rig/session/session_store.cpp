// SPDX-License-Identifier: MIT
// Opening, closing and keys; see session_store_impl.hpp for the rest.
#include "rig/session/session_store.hpp"

#include <fcntl.h>
#include <sqlite3.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "rig/errors.hpp"
#include "rig/output_place.hpp"
#include "rig/session/database_errors.hpp"
#include "rig/session/session_schema.hpp"
#include "rig/session/session_store_impl.hpp"
#include "rig/session/stored_recording.hpp"
#include "rig/whole_file.hpp"

namespace rig {

SessionStore::Impl::Impl(std::string path_, Mode mode_) : path(std::move(path_)), mode(mode_) {
  guarded(path, [&] {
    if (mode == Mode::create) create();
    if (mode == Mode::append) append();
    if (!writes()) {
      database = mode == Mode::read ? open_for_reading(path) : open_untouched(path);
      check_identity(*database, path);
      database->exec("PRAGMA mmap_size = 1073741824");
    }
    check_tables(*database, path);
  });
}

void SessionStore::Impl::create() {
  if (has_data(path))
    throw UsageError(path +
                     " exists already and is not overwritten. Choose another name, remove it, or continue it "
                     "(rig resume).");
  demand_plain_file(path);
  make_empty();
  lock = std::make_unique<WriterLock>(path);
  database = std::make_unique<SQLite::Database>(path, SQLite::OPEN_READWRITE, 5000);
  make_durable();
}

void SessionStore::Impl::demand_name() {
  if (rescued || !lock || lock->names(path)) return;
  rescued = true;
  const std::string words = path + " was removed or replaced by another program while it was written. ";
  const std::string name = std::filesystem::path(path).filename().string() + ".rescued";
  using Folder = std::filesystem::path;
  for (const Folder& refuge : {Folder(path).parent_path(), Folder("."), Folder("/tmp")}) {
    const std::string copy = (refuge / name).string();
    try {
      SQLite::Statement save(*database, "VACUUM INTO ?");
      save.bind(1, copy);
      save.exec();
    } catch (const SQLite::Exception&) {
      continue;
    }
    sync_folder(copy);
    throw MeasurementError(words + "Everything captured was saved to " + copy + ". Rename it to " + path +
                           " and continue with rig resume.");
  }
  throw MeasurementError(words + "It could not be saved elsewhere: what was captured is lost. Start again.");
}

void SessionStore::Impl::make_empty() {
  const std::string unfinished = path + ".new";
  std::error_code ignored;
  try {
    for (const char* ending : {"", "-journal"}) std::filesystem::remove(unfinished + ending, ignored);
    // SQLite does not tell why a file cannot be made.
    const int made = ::open(unfinished.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
    if (made < 0) throw UsageError("cannot write " + path + ": " + why_not_written(path, errno));
    ::close(made);
    database =
        std::make_unique<SQLite::Database>(unfinished, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE, 5000);
    make_schema(*database);
    database.reset();
    if (::rename(unfinished.c_str(), path.c_str()) != 0)
      throw UsageError("cannot write " + path + ": " + why_not_written(path, errno));
    sync_folder(path);
  } catch (...) {
    database.reset();
    std::filesystem::remove(unfinished, ignored);
    throw;
  }
}

void SessionStore::Impl::append() {
  {
    const auto looked_at = open_for_reading(path);
    check_identity(*looked_at, path);
  }
  lock = std::make_unique<WriterLock>(path);
  database = std::make_unique<SQLite::Database>(path, SQLite::OPEN_READWRITE, 5000);
  make_durable();
  complete_schema(*database);
}

void SessionStore::Impl::make_durable() {
  // EXTRA, and before the change of mode, which is made with a rollback journal: its removal must reach the
  // disk. A journal that came back after a power failure would undo what the log has been copied over since.
  database->exec("PRAGMA synchronous = EXTRA");
  database->exec("PRAGMA journal_mode = WAL");
  database->exec(
      "PRAGMA cache_size = -16384");  // 16 MB: a long capture spills to the log rather than to memory.
}

SessionStore::Impl::~Impl() {
  if (!database) return;
  try {
    if (open_capture) rollback();
    if (writes()) {
      flush();
      make_plain();
    }
  } catch (const std::exception&) {
    // What was committed is in the log; the next reader finds it there.
  }
  insert_scan.reset();
  insert_geometry.reset();
  database.reset();
}

void SessionStore::Impl::empty_log() {
  // A reader that holds an older state prevents it for a while; a disk that is full ends the run while all is
  // intact.
  const int result =
      sqlite3_wal_checkpoint_v2(database->getHandle(), nullptr, SQLITE_CHECKPOINT_PASSIVE, nullptr, nullptr);
  if (result != SQLITE_OK && result != SQLITE_BUSY && result != SQLITE_LOCKED)
    throw SQLite::Exception(database->getHandle(), result);
}

void SessionStore::Impl::make_plain() {
  insert_scan.reset();
  insert_geometry.reset();
  database->exec("PRAGMA journal_mode = DELETE");
}

void SessionStore::Impl::execute(const char* statement, std::int64_t id) {
  SQLite::Statement query(*database, statement);
  query.bind(1, id);
  query.exec();
}

SessionStore::SessionStore(const std::string& path, Mode mode) : impl_(std::make_unique<Impl>(path, mode)) {}
SessionStore::~SessionStore() = default;

const std::string& SessionStore::path() const { return impl_->path; }

void SessionStore::set(const std::string& key, const std::string& value) {
  if (impl_->open_capture) {
    impl_->waiting_keys[key] = value;
    return;
  }
  guarded(impl_->path, [&] { put_key(*impl_->database, key, value); });
}

std::optional<std::string> SessionStore::get(const std::string& key) const {
  if (const auto waiting = impl_->waiting_keys.find(key); waiting != impl_->waiting_keys.end())
    return waiting->second;
  return guarded(impl_->path, [&]() -> std::optional<std::string> {
    SQLite::Statement statement(*impl_->database, "SELECT value FROM session WHERE key = ?");
    statement.bind(1, key);
    if (!statement.executeStep() || statement.getColumn(0).isNull()) return std::nullopt;
    return statement.getColumn(0).getString();
  });
}

void SessionStore::demand_name() {
  if (impl_->open_capture) throw std::logic_error("a capture is open");  // It would not be saved.
  guarded(impl_->path, [&] { impl_->demand_name(); });
}

void SessionStore::finish() {
  guarded(impl_->path, [&] {
    if (impl_->open_capture) impl_->rollback();
    impl_->flush();
    impl_->demand_name();
    if (impl_->rescued) return;
    try {
      impl_->make_plain();
    } catch (const SQLite::Exception&) {
      // What was committed is in the log; the next reader finds it there.
    }
    impl_->demand_name();  // It may have been removed just now.
  });
}

std::unique_ptr<fit::Recording> SessionStore::recording(const std::optional<fit::Bench>& bench) const {
  if (impl_->writes() && !impl_->open_capture) guarded(impl_->path, [&] { impl_->flush(); });
  std::optional<fit::Bench> known = bench;
  if (!known) {
    const auto text = get("bench");
    if (!text)
      throw UsageError(impl_->path +
                       " holds no bench: it ended before its run began. Of the commands that read one, "
                       "`rig explain` takes it from --bench FILE.");
    try {
      known = fit::parse_bench(*text, impl_->path + " (its bench)");
    } catch (const std::invalid_argument& error) {
      throw UsageError(error.what());
    }
  }
  return guarded(impl_->path,
                 [&] { return make_stored_recording(*impl_->database, impl_->path, std::move(*known)); });
}

bool is_session_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file && ::access(path.c_str(), F_OK) != 0)
    throw UsageError(path + ": no such " + (path.ends_with(".rig") ? "session " : "") +
                     "file. Check the name and the folder.");
  if (!file) throw UsageError(path + " cannot be read: permission denied. Check the file's permissions.");
  std::string head(15, '\0');
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  return head == "SQLite format 3" || path.ends_with(".rig");
}

}  // namespace rig
