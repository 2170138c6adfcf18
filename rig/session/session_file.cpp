// SPDX-License-Identifier: MIT
#include "rig/session/session_file.hpp"

#include <fcntl.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <fstream>

#include "rig/errors.hpp"

namespace rig {
namespace {

std::string immutable_uri(const std::string& path) {
  std::string uri = "file:";
  for (const char c : std::filesystem::absolute(path).string()) {
    if (c == '%' || c == '?' || c == '#')
      uri += c == '%' ? "%25" : c == '?' ? "%3f" : "%23";
    else
      uri += c;
  }
  return uri + "?immutable=1";
}

void demand_readable(const std::string& path) {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0)
    throw UsageError(path + ": no such session file. Check the name and the folder.");
  if (S_ISDIR(found.st_mode)) throw UsageError(path + " is a folder, not a session file.");
  if (!S_ISREG(found.st_mode)) throw UsageError(path + " is not a regular file, and so no session.");
  if (found.st_size == 0 && !has_data(path + "-wal") && !has_data(path + "-journal"))
    throw UsageError(path + " is empty: there is no session in it.");
  if (::access(path.c_str(), R_OK) != 0)
    throw UsageError(path + " cannot be read: permission denied. Check the file's permissions.");
}

/// A stranger's file may call a view by the name of a table, and reading that could take for ever.
void demand_plain_tables(SQLite::Database& database, const std::string& path) {
  SQLite::Statement row(
      database,
      "SELECT name FROM sqlite_schema WHERE name IN ('session', 'capture', 'scan', 'scan_geometry',"
      " 'pose', 'result', 'event', 'progress') AND (type <> 'table' OR sql NOT LIKE 'CREATE TABLE%')");
  if (row.executeStep())
    throw UsageError(path + " has something other than a plain table under the name '" +
                     row.getColumn(0).getString() + "': it is damaged or malicious, and is not read.");
}

}  // namespace

WriterLock::WriterLock(const std::string& path) : fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  if (fd_ >= 0 && ::flock(fd_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    ::close(fd_);
    throw UsageError(path + " is being written by another program. Wait for it to finish or stop it.");
  }
}

WriterLock::~WriterLock() {
  if (fd_ >= 0) ::close(fd_);
}

bool WriterLock::names(const std::string& path) const {
  struct stat open {
  }, named{};
  if (fd_ < 0 || ::fstat(fd_, &open) != 0) return true;
  return ::stat(path.c_str(), &named) == 0 && open.st_dev == named.st_dev && open.st_ino == named.st_ino;
}

bool has_data(const std::string& path) {
  std::error_code ignored;
  const auto size = std::filesystem::file_size(path, ignored);
  return !ignored && size > 0;
}

void fold_log(const std::string& path) {
  if (!has_data(path + "-wal") || ::access(path.c_str(), W_OK) != 0) return;
  try {
    // SQLite gives the mode up only while nobody else has the session open: a run that goes on keeps its log.
    SQLite::Database database(path, SQLite::OPEN_READWRITE, 0);
    if (database.execAndGet("PRAGMA user_version").getInt() < 0) return;
    database.exec("PRAGMA journal_mode = DELETE");
  } catch (const SQLite::Exception&) {
    // Read as it is: a run goes on, or what is wrong with the file is reported by the reader.
  }
}

std::string words_about_log(const std::string& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return "";
  if (has_data(path + "-wal"))
    return path + " has a log beside it (" + path +
           "-wal): its run is in progress, or was killed. What is in the log belongs to the session: always "
           "copy both together.";
  std::ifstream file(path, std::ios::binary);
  std::string head(20, '\0');
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  const bool logged = file.gcount() == 20 && head.starts_with("SQLite format 3") && head[18] == 2;
  if (!logged) return "";
  return path + " was not closed by its run, and has no log beside it (" + path +
         "-wal). If it is a copy, copy the log too: the last captures may be in it.";
}

std::unique_ptr<SQLite::Database> open_for_reading(const std::string& path) {
  demand_readable(path);
  fold_log(path);
  try {
    auto database = std::make_unique<SQLite::Database>(path, SQLite::OPEN_READONLY, 2000);
    (void)database->execAndGet("PRAGMA user_version").getInt();
    (void)database->execAndGet("SELECT count(*) FROM sqlite_schema").getInt();
    return database;
  } catch (const SQLite::Exception& error) {
    const int code = error.getErrorCode();
    if (code != SQLITE_CANTOPEN && code != SQLITE_READONLY && code != SQLITE_IOERR) throw;
    // Power that failed while the file was made leaves a journal that only a writer may roll back.
    if (has_data(path + "-journal") && ::access(path.c_str(), W_OK) == 0) {
      SQLite::Database repaired(path, SQLite::OPEN_READWRITE, 2000);
      (void)repaired.execAndGet("SELECT count(*) FROM sqlite_schema").getInt();
      return std::make_unique<SQLite::Database>(path, SQLite::OPEN_READONLY, 2000);
    }
    // On read-only media the side files of the write-ahead log cannot be made. Without a log there is nothing
    // in them to miss.
    if (has_data(path + "-wal"))
      throw UsageError(path + " lies on a read-only disk beside an unfinished log (" + path +
                       "-wal). Copy both to a writable folder and read the copy.");
    return std::make_unique<SQLite::Database>(immutable_uri(path), SQLite::OPEN_READONLY | SQLite::OPEN_URI,
                                              2000);
  }
}

std::unique_ptr<SQLite::Database> open_untouched(const std::string& path) {
  constexpr int longest_value_bytes = 64'000'000, most_columns = 64;
  demand_readable(path);
  for (const char* ending : {"-wal", "-journal"})
    if (has_data(path + ending))
      throw UsageError(
          path + " has a log beside it (" + path + ending +
          "): it is being written, or its run was killed. Let it end, or continue with rig resume.");
  auto database =
      std::make_unique<SQLite::Database>(immutable_uri(path), SQLite::OPEN_READONLY | SQLite::OPEN_URI, 2000);
  sqlite3_limit(database->getHandle(), SQLITE_LIMIT_LENGTH, longest_value_bytes);
  sqlite3_limit(database->getHandle(), SQLITE_LIMIT_COLUMN, most_columns);
  database->exec("PRAGMA trusted_schema = OFF");
  database->exec("PRAGMA cell_size_check = ON");
  demand_plain_tables(*database, path);
  return database;
}

namespace {

/// MAJOR:MINOR in the figures of /proc/locks, empty if it is not known. A layered file system lists its locks
/// under the device of its mount, and tells another one of a file.
std::string device_of_mount(std::uint64_t mount) {
  std::ifstream mounts("/proc/self/mountinfo");
  for (std::string line; std::getline(mounts, line);) {
    unsigned long long id = 0;
    unsigned int major = 0, minor = 0;
    if (std::sscanf(line.c_str(), "%llu %*u %u:%u", &id, &major, &minor) != 3 || id != mount) continue;
    char text[32];
    std::snprintf(text, sizeof text, " %02x:%02x", major, minor);
    return text;
  }
  return "";
}

}  // namespace

bool is_being_written(const std::string& path) {
  struct statx named {};
  if (::statx(AT_FDCWD, path.c_str(), 0, STATX_INO | STATX_MNT_ID, &named) != 0) return false;
  const std::string wanted = device_of_mount(named.stx_mnt_id) + ":" + std::to_string(named.stx_ino) + " ";
  std::ifstream locks("/proc/locks");
  for (std::string line; std::getline(locks, line);)
    if (line.find(" FLOCK ") != std::string::npos && line.find(" WRITE ") != std::string::npos &&
        line.find(wanted) != std::string::npos)
      return true;
  return false;
}

}  // namespace rig
