// SPDX-License-Identifier: MIT
#include "rig/session/session_store.hpp"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fcntl.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <stdexcept>

#include "rig/errors.hpp"
#include "rig/output_place.hpp"
#include "rig/session/sha256.hpp"

namespace rig {
namespace {

constexpr int schema_version = 1;
// A scan of 1081 ranges and intensities (4324 bytes) then lies whole in one page: WITHOUT ROWID tables move
// rows above about an eighth of a page to overflow chains, which halves the reading speed.
constexpr int page_bytes = 32768;
constexpr std::size_t poses_per_transaction = 4096;
constexpr int most_beams = 100'000;

constexpr const char* schema = R"(
CREATE TABLE session(key TEXT PRIMARY KEY, value TEXT);
CREATE TABLE capture(
  id INTEGER PRIMARY KEY,
  step TEXT,
  started_us INTEGER NOT NULL,
  stage_deg REAL NOT NULL,
  stage_readback_deg REAL,
  approach INTEGER NOT NULL,
  target TEXT,
  target_shift_mm REAL NOT NULL DEFAULT 0,
  reflectance REAL,
  temperature_c REAL,
  since_power_on_s REAL,
  stage_rate_deg_s REAL NOT NULL DEFAULT 0,
  first_step INTEGER NOT NULL, last_step INTEGER NOT NULL, cluster INTEGER NOT NULL DEFAULT 1
);
CREATE TABLE scan(
  capture INTEGER NOT NULL REFERENCES capture(id), seq INTEGER NOT NULL,
  device_ms INTEGER NOT NULL,
  host_us INTEGER NOT NULL,
  range_mm BLOB NOT NULL,
  intensity BLOB,
  PRIMARY KEY(capture, seq)) WITHOUT ROWID;
CREATE TABLE pose(host_us INTEGER NOT NULL, x_mm REAL, y_mm REAL, heading_deg REAL,
  wheel_left_rad REAL, wheel_right_rad REAL, stage_deg REAL);
CREATE TABLE result(kind TEXT, created_utc TEXT, json TEXT);
CREATE TABLE event(host_us INTEGER, level TEXT, text TEXT);
CREATE TABLE scan_geometry(capture INTEGER, seq INTEGER, first_deg REAL NOT NULL, step_deg REAL NOT NULL, scan_s REAL,
  PRIMARY KEY(capture, seq)) WITHOUT ROWID;
CREATE TABLE progress(step TEXT PRIMARY KEY, json TEXT);
)";

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&now, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text;
}

/// Degrees as a person wrote them: 0.3 rather than the 0.30000000000000004 that a trip through radians
/// leaves.
double file_degrees(double rad) { return std::round(rad * fit::deg_per_rad * 1e9) / 1e9; }

template <class T, class F>
void bind_optional(SQLite::Statement& statement, int index, const std::optional<T>& value, F convert) {
  if (value)
    statement.bind(index, convert(*value));
  else
    statement.bind(index);
}

constexpr auto as_is = [](const auto& value) { return value; };

std::optional<double> optional_real(const SQLite::Statement& row, int index, double scale = 1) {
  const SQLite::Column column = row.getColumn(index);
  if (column.isNull()) return std::nullopt;
  return column.getDouble() * scale;
}

/// Blobs are little-endian whatever the machine.
void swap_if_big_endian(std::vector<std::uint16_t>& values) {
  if constexpr (std::endian::native == std::endian::big)
    for (auto& value : values) value = static_cast<std::uint16_t>(value >> 8 | value << 8);
}

void bind_blob(SQLite::Statement& statement, int index, std::span<const std::uint16_t> values,
               std::vector<std::uint16_t>& swapped) {
  if constexpr (std::endian::native == std::endian::big) {
    swapped.assign(values.begin(), values.end());
    swap_if_big_endian(swapped);
    values = swapped;
  }
  // An empty blob needs a pointer all the same: a null one would be stored as NULL.
  static constexpr char nothing = 0;
  const void* bytes = values.empty() ? static_cast<const void*>(&nothing) : values.data();
  statement.bindNoCopy(index, bytes, static_cast<int>(values.size_bytes()));
}

/// Runs `work`, turning the database's words into the operator's.
template <class F>
auto guarded(const std::string& path, F work) {
  try {
    return work();
  } catch (const SQLite::Exception& error) {
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
}

/// Holds an advisory lock for as long as the writer lives, so that a second `rig run` on the same file is
/// told so. SQLite's own locks are per transaction only.
class WriterLock {
 public:
  explicit WriterLock(const std::string& path) : fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    if (fd_ >= 0 && ::flock(fd_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
      ::close(fd_);
      throw UsageError(path + " is being written by another program. Wait for it to finish or stop it.");
    }
  }
  ~WriterLock() {
    if (fd_ >= 0) ::close(fd_);
  }
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

  /// Whether the file still has its name: it may have been removed or replaced meanwhile.
  [[nodiscard]] bool names(const std::string& path) const {
    struct stat open {
    }, named{};
    if (fd_ < 0 || ::fstat(fd_, &open) != 0) return true;
    return ::stat(path.c_str(), &named) == 0 && open.st_dev == named.st_dev && open.st_ino == named.st_ino;
  }

 private:
  int fd_;
};

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

/// A name is on the disk only when its folder is.
void sync_folder(const std::string& path) {
  const auto folder = std::filesystem::absolute(path).parent_path();
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  ::fsync(fd);
  ::close(fd);
}

bool has_data(const std::string& path) {
  std::error_code ignored;
  const auto size = std::filesystem::file_size(path, ignored);
  return !ignored && size > 0;
}

std::unique_ptr<SQLite::Database> open_for_reading(const std::string& path) {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0)
    throw UsageError(path + ": no such session file. Check the name and the folder.");
  if (S_ISDIR(found.st_mode)) throw UsageError(path + " is a folder, not a session file.");
  if (::access(path.c_str(), R_OK) != 0)
    throw UsageError(path + " cannot be read: permission denied. Check the file's permissions.");
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
      SQLite::Database mended(path, SQLite::OPEN_READWRITE, 2000);
      (void)mended.execAndGet("SELECT count(*) FROM sqlite_schema").getInt();
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

void check_identity(SQLite::Database& database, const std::string& path) {
  const int application = database.execAndGet("PRAGMA application_id").getInt();
  const int version = database.execAndGet("PRAGMA user_version").getInt();
  if (application != static_cast<int>(session_application_id))
    throw UsageError(path + " is an SQLite database but not a session file of rig (application id " +
                     std::to_string(application) + "). Use `rig import` for other tools' recordings.");
  if (version > schema_version)
    throw UsageError(path + " was written by a later version of rig (format " + std::to_string(version) +
                     ", this one reads up to " + std::to_string(schema_version) +
                     "). Update rig to read it.");
}

fit::CaptureInfo read_capture(const SQLite::Statement& row, const std::string& path) {
  fit::CaptureInfo info;
  info.id = row.getColumn(0).getInt64();
  info.step = row.getColumn(1).getString();
  info.started_us = row.getColumn(2).getInt64();
  info.stage_rad = row.getColumn(3).getDouble() * fit::rad_per_deg;
  info.stage_readback_rad = optional_real(row, 4, fit::rad_per_deg);
  info.approach = row.getColumn(5).getInt();
  if (!row.getColumn(6).isNull()) info.target = row.getColumn(6).getString();
  info.target_shift_mm = row.getColumn(7).getDouble();
  info.reflectance = optional_real(row, 8);
  info.temperature_c = optional_real(row, 9);
  info.since_power_on_s = optional_real(row, 10);
  info.stage_rate_rad_s = row.getColumn(11).getDouble() * fit::rad_per_deg;
  info.first_step = row.getColumn(12).getInt();
  info.last_step = row.getColumn(13).getInt();
  info.cluster = row.getColumn(14).getInt();
  if (info.first_step < 0 || info.last_step < info.first_step || info.cluster < 1 ||
      info.last_step > most_beams)
    throw UsageError(path + ": capture " + std::to_string(info.id) + " has the impossible step range " +
                     std::to_string(info.first_step) + ".." + std::to_string(info.last_step) +
                     " in clusters of " + std::to_string(info.cluster) +
                     ". The file is damaged or was made by a faulty program.");
  return info;
}

constexpr const char* select_captures =
    "SELECT id, step, started_us, stage_deg, stage_readback_deg, approach, target, target_shift_mm, "
    "reflectance,"
    " temperature_c, since_power_on_s, stage_rate_deg_s, first_step, last_step, cluster FROM capture ORDER "
    "BY id";

/// Walks the scans of one capture, copying each blob once into a buffer that is aligned for its values.
class ScanReader {
 public:
  ScanReader(SQLite::Database& database, const std::string& path, const fit::CaptureInfo& info)
      : path_(path),
        info_(info),
        with_geometry_(has_geometry(database, info.id)),
        scans_(database, with_geometry_
                             ? "SELECT s.seq, s.device_ms, s.host_us, s.range_mm, s.intensity, g.first_deg,"
                               " g.step_deg, g.scan_s FROM scan s LEFT JOIN scan_geometry g"
                               " ON g.capture = s.capture AND g.seq = s.seq WHERE s.capture = ?"
                               " ORDER BY s.seq"
                             : "SELECT seq, device_ms, host_us, range_mm, intensity FROM scan"
                               " WHERE capture = ? ORDER BY seq") {
    scans_.bind(1, info.id);
  }

  void walk(const std::function<void(const fit::ScanView&)>& visit) {
    while (scans_.executeStep()) visit(view(info_));
  }

 private:
  fit::ScanView view(const fit::CaptureInfo& info) {
    fit::ScanView scan;
    scan.seq = scans_.getColumn(0).getInt64();
    scan.device_ms = scans_.getColumn(1).getInt64();
    scan.host_us = scans_.getColumn(2).getInt64();
    scan.range_mm = values_of(3, ranges_);
    scan.intensity = values_of(4, intensities_);
    if (with_geometry_ && !scans_.getColumn(5).isNull())
      scan.geometry =
          fit::ScanGeometry{scans_.getColumn(5).getDouble() * fit::rad_per_deg,
                            scans_.getColumn(6).getDouble() * fit::rad_per_deg, optional_real(scans_, 7)};
    const auto beams = static_cast<std::size_t>(info.beams());
    if (!scan.geometry && scan.range_mm.size() != beams) refuse(info, scan.seq, scan.range_mm.size(), beams);
    if (!scan.intensity.empty() && scan.intensity.size() != scan.range_mm.size())
      refuse(info, scan.seq, scan.intensity.size(), scan.range_mm.size());
    return scan;
  }

  /// Hardly any capture has: looking for it scan by scan would cost more than the scans themselves.
  static bool has_geometry(SQLite::Database& database, std::int64_t capture) {
    if (!database.tableExists("scan_geometry")) return false;
    SQLite::Statement any(database, "SELECT 1 FROM scan_geometry WHERE capture = ? LIMIT 1");
    any.bind(1, capture);
    return any.executeStep();
  }

  /// SQLite's own copy of the blob, where it can be read as it is.
  std::span<const std::uint16_t> values_of(int index, std::vector<std::uint16_t>& own) {
    const SQLite::Column column = scans_.getColumn(index);
    const void* bytes = column.getBlob();
    const auto size = static_cast<std::size_t>(column.getBytes()) / 2;
    const bool aligned = reinterpret_cast<std::uintptr_t>(bytes) % alignof(std::uint16_t) == 0;
    if (std::endian::native == std::endian::little && aligned)
      return {static_cast<const std::uint16_t*>(bytes), size};
    own.resize(size);
    if (size > 0) std::memcpy(own.data(), bytes, 2 * size);
    swap_if_big_endian(own);
    return own;
  }

  [[noreturn]] void refuse(const fit::CaptureInfo& info, std::int64_t seq, std::size_t got,
                           std::size_t wanted) const {
    throw UsageError(path_ + ": scan " + std::to_string(seq) + " of capture " + std::to_string(info.id) +
                     " holds " + std::to_string(got) + " values where " + std::to_string(wanted) +
                     " were expected. The file is damaged or was made by a faulty program.");
  }

  const std::string& path_;
  const fit::CaptureInfo& info_;
  bool with_geometry_;
  SQLite::Statement scans_;
  std::vector<std::uint16_t> ranges_, intensities_;  // where SQLite's copies cannot be used
};

std::vector<fit::TrackPose> read_track(SQLite::Database& database) {
  std::vector<fit::TrackPose> track;
  if (!database.tableExists("pose")) return track;
  SQLite::Statement row(
      database,
      "SELECT host_us, x_mm, y_mm, heading_deg, wheel_left_rad, wheel_right_rad, stage_deg FROM pose"
      " ORDER BY host_us, rowid");
  while (row.executeStep())
    track.push_back({row.getColumn(0).getInt64(), optional_real(row, 1), optional_real(row, 2),
                     optional_real(row, 3, fit::rad_per_deg), optional_real(row, 4), optional_real(row, 5),
                     optional_real(row, 6, fit::rad_per_deg)});
  return track;
}

class StoredRecording final : public fit::Recording {
 public:
  StoredRecording(SQLite::Database& database, std::string path, fit::Bench bench)
      : database_(database), path_(std::move(path)), bench_(std::move(bench)) {
    SQLite::Statement row(database_, select_captures);
    while (row.executeStep()) captures_.push_back(read_capture(row, path_));
    track_ = read_track(database_);
  }
  const fit::Bench& bench() const override { return bench_; }
  const std::vector<fit::CaptureInfo>& captures() const override { return captures_; }
  const std::vector<fit::TrackPose>& track() const override { return track_; }
  void for_each_scan(std::size_t index,
                     const std::function<void(const fit::ScanView&)>& visit) const override {
    guarded(path_, [&] { ScanReader(database_, path_, captures_.at(index)).walk(visit); });
  }

 private:
  SQLite::Database& database_;
  std::string path_;
  fit::Bench bench_;
  std::vector<fit::CaptureInfo> captures_;
  std::vector<fit::TrackPose> track_;
};

void insert_pose(SQLite::Statement& insert, const fit::TrackPose& pose) {
  insert.reset();
  insert.bind(1, pose.host_us);
  bind_optional(insert, 2, pose.x_mm, as_is);
  bind_optional(insert, 3, pose.y_mm, as_is);
  bind_optional(insert, 4, pose.heading_rad, file_degrees);
  bind_optional(insert, 5, pose.wheel_left_rad, as_is);
  bind_optional(insert, 6, pose.wheel_right_rad, as_is);
  bind_optional(insert, 7, pose.stage_rad, file_degrees);
  insert.exec();
}

}  // namespace

struct SessionStore::Impl {
  std::string path;
  Mode mode;
  // The lock goes last: closing any descriptor of the file drops SQLite's own locks on it.
  std::unique_ptr<WriterLock> lock;
  mutable std::unique_ptr<SQLite::Database> database;
  std::optional<SQLite::Statement> insert_scan, insert_geometry;
  std::optional<std::int64_t> open_capture;
  int open_capture_beams = 0;
  bool rescued = false;  // Once is enough: what follows is the end of the run.
  std::vector<fit::TrackPose> poses;
  std::vector<Event> waiting_events;
  std::vector<std::uint16_t> swapped;

  Impl(std::string path_, Mode mode_) : path(std::move(path_)), mode(mode_) {
    guarded(path, [&] {
      if (mode == Mode::create) create();
      if (mode == Mode::append) append();
      if (mode == Mode::read) {
        database = open_for_reading(path);
        check_identity(*database, path);
        database->exec("PRAGMA mmap_size = 1073741824");
      }
      if (!database->tableExists("session") || !database->tableExists("capture") ||
          !database->tableExists("scan"))
        throw UsageError(path + " lacks the tables of a session file. It is damaged or was never finished.");
    });
  }

  void create() {
    if (has_data(path))
      throw UsageError(
          path +
          " exists already and is not overwritten. Choose another name, remove it, or go on with "
          "it (--resume).");
    const auto folder = std::filesystem::absolute(path).parent_path();
    if (!std::filesystem::is_directory(folder))
      throw UsageError(folder.string() + ": no such folder, so " + path +
                       " cannot be made. Make the folder first.");
    if (::access(folder.c_str(), W_OK) != 0)
      throw UsageError(folder.string() + " cannot be written, so " + path +
                       " cannot be made. Choose another folder or mend its permissions.");
    make_empty();
    lock = std::make_unique<WriterLock>(path);
    database = std::make_unique<SQLite::Database>(path, SQLite::OPEN_READWRITE, 5000);
    make_durable();
  }

  /// A session that was removed or replaced while it is written goes on without a name and ends with this
  /// program: all of it is saved under another name, and the run stops.
  void demand_name() {
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
                             " and go on with --resume.");
    }
    throw MeasurementError(words + "It could not be saved elsewhere: what was captured is lost. Begin anew.");
  }

  /// Made under another name and renamed, so that a session that exists is whole whenever the power fails.
  void make_empty() {
    const std::string unfinished = path + ".new";
    try {
      for (const char* ending : {"", "-journal"}) std::filesystem::remove(unfinished + ending);
      database =
          std::make_unique<SQLite::Database>(unfinished, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE, 5000);
      database->exec("PRAGMA page_size = " + std::to_string(page_bytes));
      database->exec("PRAGMA synchronous = FULL");
      SQLite::Transaction transaction(*database);
      database->exec("PRAGMA application_id = " + std::to_string(session_application_id));
      database->exec("PRAGMA user_version = " + std::to_string(schema_version));
      database->exec(schema);
      put("created_utc", utc_now());
      put("software", "rig " RIG_VERSION);
      transaction.commit();
      database.reset();
      std::filesystem::rename(unfinished, path);
      sync_folder(path);
    } catch (...) {
      database.reset();
      std::error_code ignored;
      std::filesystem::remove(unfinished, ignored);
      throw;
    }
  }

  void append() {
    {
      const auto looked_at = open_for_reading(path);
      check_identity(*looked_at, path);
    }
    lock = std::make_unique<WriterLock>(path);
    database = std::make_unique<SQLite::Database>(path, SQLite::OPEN_READWRITE, 5000);
    make_durable();
    database->exec("CREATE TABLE IF NOT EXISTS progress(step TEXT PRIMARY KEY, json TEXT)");
    database->exec(
        "CREATE TABLE IF NOT EXISTS scan_geometry(capture INTEGER, seq INTEGER, first_deg REAL NOT NULL,"
        " step_deg REAL NOT NULL, scan_s REAL, PRIMARY KEY(capture, seq)) WITHOUT ROWID");
  }

  void make_durable() {
    database->exec("PRAGMA journal_mode = WAL");
    database->exec("PRAGMA synchronous = FULL");
    database->exec(
        "PRAGMA cache_size = -16384");  // 16 MB: a long capture spills to the log rather than to memory.
  }

  ~Impl() {
    if (!database) return;
    try {
      if (open_capture) rollback();
      if (mode != Mode::read) {
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

  /// A finished session is one plain file, which other clients can read from read-only media too.
  void make_plain() {
    insert_scan.reset();
    insert_geometry.reset();
    database->exec("PRAGMA journal_mode = DELETE");
  }

  void put(const std::string& key, const std::string& value) {
    SQLite::Statement statement(*database, "INSERT OR REPLACE INTO session(key, value) VALUES(?, ?)");
    statement.bind(1, key);
    statement.bind(2, value);
    statement.exec();
  }

  void execute(const char* statement, std::int64_t id) {
    SQLite::Statement query(*database, statement);
    query.bind(1, id);
    query.exec();
  }

  void require_open(std::int64_t capture) {
    if (open_capture != capture)
      throw std::logic_error("capture " + std::to_string(capture) + " is not open");
    require_transaction();
  }

  /// A failing disk makes SQLite roll back by itself: what follows must not be written without the capture.
  void require_transaction() {
    if (!open_capture || sqlite3_get_autocommit(database->getHandle()) == 0) return;
    rollback();
    throw MeasurementError(
        "The disk refused the capture that was being written to " + path +
        ". What was captured before is intact. Free some space or check the disk, then run again with "
        "--resume.");
  }

  void write_poses() {
    if (poses.empty()) return;
    SQLite::Statement insert(*database, "INSERT INTO pose VALUES(?, ?, ?, ?, ?, ?, ?)");
    for (const auto& pose : poses) insert_pose(insert, pose);
    poses.clear();
  }

  /// Writes what waited for the end of a capture.
  void flush() {
    if (poses.empty() && waiting_events.empty()) return;
    SQLite::Transaction transaction(*database, SQLite::TransactionBehavior::IMMEDIATE);
    write_poses();
    write_events();
    transaction.commit();
  }

  void write_events() {
    for (const auto& event : waiting_events) write_event(event);
    waiting_events.clear();
  }

  void write_event(const Event& event) {
    SQLite::Statement statement(*database, "INSERT INTO event VALUES(?, ?, ?)");
    statement.bind(1, event.host_us);
    statement.bind(2, event.level);
    statement.bind(3, event.text);
    statement.exec();
  }

  void rollback() {
    open_capture.reset();
    if (insert_scan) insert_scan->reset();
    if (insert_geometry) insert_geometry->reset();
    // A full disk makes SQLite roll back by itself; a second ROLLBACK would then be an error.
    if (sqlite3_get_autocommit(database->getHandle()) == 0) database->exec("ROLLBACK");
  }

  std::int64_t begin(const fit::CaptureInfo& info);
  void add(const fit::ScanView& scan);
};

std::int64_t SessionStore::Impl::begin(const fit::CaptureInfo& info) {
  flush();
  database->exec("BEGIN IMMEDIATE");
  try {
    SQLite::Statement insert(
        *database,
        "INSERT INTO capture(step, started_us, stage_deg, stage_readback_deg, approach, target,"
        " target_shift_mm, reflectance, temperature_c, since_power_on_s, stage_rate_deg_s,"
        " first_step, last_step, cluster) VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?)");
    insert.bind(1, info.step);
    insert.bind(2, info.started_us);
    insert.bind(3, file_degrees(info.stage_rad));
    bind_optional(insert, 4, info.stage_readback_rad, file_degrees);
    insert.bind(5, info.approach);
    bind_optional(insert, 6, info.target, as_is);
    insert.bind(7, info.target_shift_mm);
    bind_optional(insert, 8, info.reflectance, as_is);
    bind_optional(insert, 9, info.temperature_c, as_is);
    bind_optional(insert, 10, info.since_power_on_s, as_is);
    insert.bind(11, file_degrees(info.stage_rate_rad_s));
    insert.bind(12, info.first_step);
    insert.bind(13, info.last_step);
    insert.bind(14, info.cluster);
    insert.exec();
  } catch (...) {
    rollback();
    throw;
  }
  open_capture = database->getLastInsertRowid();
  open_capture_beams = info.beams();
  if (!insert_scan) {
    insert_scan.emplace(*database, "INSERT INTO scan VALUES(?, ?, ?, ?, ?, ?)");
    insert_geometry.emplace(*database, "INSERT INTO scan_geometry VALUES(?, ?, ?, ?, ?)");
  }
  return *open_capture;
}

void SessionStore::Impl::add(const fit::ScanView& scan) {
  if (!scan.geometry && scan.range_mm.size() != static_cast<std::size_t>(open_capture_beams))
    throw std::logic_error("a scan of " + std::to_string(scan.range_mm.size()) + " values in a capture of " +
                           std::to_string(open_capture_beams));
  insert_scan->reset();
  insert_scan->bind(1, *open_capture);
  insert_scan->bind(2, scan.seq);
  insert_scan->bind(3, scan.device_ms);
  insert_scan->bind(4, scan.host_us);
  bind_blob(*insert_scan, 5, scan.range_mm, swapped);
  std::vector<std::uint16_t> swapped_intensity;
  if (scan.intensity.empty())
    insert_scan->bind(6);
  else
    bind_blob(*insert_scan, 6, scan.intensity, swapped_intensity);
  insert_scan->exec();
  if (!scan.geometry) return;
  insert_geometry->reset();
  insert_geometry->bind(1, *open_capture);
  insert_geometry->bind(2, scan.seq);
  insert_geometry->bind(3, file_degrees(scan.geometry->first_rad));
  insert_geometry->bind(4, file_degrees(scan.geometry->step_rad));
  bind_optional(*insert_geometry, 5, scan.geometry->scan_s, as_is);
  insert_geometry->exec();
}

SessionStore::SessionStore(const std::string& path, Mode mode) : impl_(std::make_unique<Impl>(path, mode)) {}
SessionStore::~SessionStore() = default;

const std::string& SessionStore::path() const { return impl_->path; }

void SessionStore::set(const std::string& key, const std::string& value) {
  guarded(impl_->path, [&] { impl_->put(key, value); });
}

std::optional<std::string> SessionStore::get(const std::string& key) const {
  return guarded(impl_->path, [&]() -> std::optional<std::string> {
    SQLite::Statement statement(*impl_->database, "SELECT value FROM session WHERE key = ?");
    statement.bind(1, key);
    if (!statement.executeStep() || statement.getColumn(0).isNull()) return std::nullopt;
    return statement.getColumn(0).getString();
  });
}

std::int64_t SessionStore::begin_capture(const fit::CaptureInfo& info) {
  if (impl_->open_capture) throw std::logic_error("one capture at a time");
  return guarded(impl_->path, [&] { return impl_->begin(info); });
}

void SessionStore::add_scan(std::int64_t capture, const fit::ScanView& scan) {
  impl_->require_open(capture);
  guarded(impl_->path, [&] { impl_->add(scan); });
}

void SessionStore::commit_capture(std::int64_t capture) {
  impl_->require_open(capture);
  guarded(impl_->path, [&] {
    impl_->write_poses();
    impl_->write_events();
    impl_->insert_scan->reset();
    impl_->insert_geometry->reset();
    try {
      impl_->database->exec("COMMIT");
    } catch (...) {
      impl_->rollback();
      throw;
    }
    impl_->open_capture.reset();
    impl_->demand_name();
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

void SessionStore::abandon_capture(std::int64_t capture) {
  impl_->require_open(capture);
  guarded(impl_->path, [&] {
    impl_->rollback();
    impl_->flush();
  });
}

void SessionStore::set_progress(const std::string& step, const std::string& json) {
  impl_->require_transaction();
  guarded(impl_->path, [&] {
    SQLite::Statement statement(*impl_->database, "INSERT OR REPLACE INTO progress VALUES(?, ?)");
    statement.bind(1, step);
    statement.bind(2, json);
    statement.exec();
  });
}

std::map<std::string, std::string> SessionStore::progress() const {
  return guarded(impl_->path, [&] {
    std::map<std::string, std::string> steps;
    if (!impl_->database->tableExists("progress")) return steps;
    SQLite::Statement row(*impl_->database, "SELECT step, json FROM progress");
    while (row.executeStep()) steps[row.getColumn(0).getString()] = row.getColumn(1).getString();
    return steps;
  });
}

void SessionStore::mark_short(std::int64_t capture) {
  impl_->require_open(capture);
  guarded(impl_->path,
          [&] { impl_->execute("UPDATE capture SET step = step || ' (short)' WHERE id = ?", capture); });
}

void SessionStore::replace_capture(std::int64_t old_capture) {
  if (!impl_->open_capture || impl_->open_capture == old_capture)
    throw std::logic_error("only an open capture replaces another");
  guarded(impl_->path, [&] {
    impl_->execute("DELETE FROM scan_geometry WHERE capture = ?", old_capture);
    impl_->execute("DELETE FROM scan WHERE capture = ?", old_capture);
    impl_->execute("DELETE FROM capture WHERE id = ?", old_capture);
  });
}

void SessionStore::forget_progress(const std::vector<std::string>& steps,
                                   const std::vector<std::int64_t>& captures) {
  if (impl_->open_capture) throw std::logic_error("progress is not forgotten inside a capture");
  guarded(impl_->path, [&] {
    SQLite::Transaction transaction(*impl_->database, SQLite::TransactionBehavior::IMMEDIATE);
    SQLite::Statement forget(*impl_->database, "DELETE FROM progress WHERE step = ?");
    for (const auto& step : steps) {
      forget.reset();
      forget.bind(1, step);
      forget.exec();
    }
    for (const auto id : captures)
      impl_->execute("UPDATE capture SET step = step || ' (repeated)' WHERE id = ?", id);
    transaction.commit();
  });
}

void SessionStore::for_each_scan(std::int64_t capture,
                                 const std::function<void(const fit::ScanView&)>& visit) const {
  guarded(impl_->path, [&] {
    std::string query = select_captures;
    query.replace(query.find(" ORDER BY"), std::string::npos, " WHERE id = ?");
    SQLite::Statement row(*impl_->database, query);
    row.bind(1, capture);
    if (!row.executeStep())
      throw MeasurementError(impl_->path + " has no capture " + std::to_string(capture) + ".");
    const fit::CaptureInfo info = read_capture(row, impl_->path);
    ScanReader(*impl_->database, impl_->path, info).walk(visit);
  });
}

void SessionStore::add_pose(const fit::TrackPose& pose) {
  impl_->poses.push_back(pose);
  if (impl_->poses.size() < poses_per_transaction) return;
  guarded(impl_->path, [&] {
    if (impl_->open_capture)
      impl_->write_poses();
    else
      impl_->flush();
  });
}

void SessionStore::add_result(const std::string& kind, const std::string& json) {
  guarded(impl_->path, [&] {
    SQLite::Statement statement(*impl_->database, "INSERT INTO result VALUES(?, ?, ?)");
    statement.bind(1, kind);
    statement.bind(2, utc_now());
    statement.bind(3, json);
    statement.exec();
  });
}

std::optional<std::string> SessionStore::latest_result(const std::string& kind) const {
  return guarded(impl_->path, [&]() -> std::optional<std::string> {
    SQLite::Statement statement(*impl_->database,
                                "SELECT json FROM result WHERE kind = ? ORDER BY rowid DESC LIMIT 1");
    statement.bind(1, kind);
    if (!statement.executeStep()) return std::nullopt;
    return statement.getColumn(0).getString();
  });
}

std::vector<SessionStore::Result> SessionStore::latest_results() const {
  return guarded(impl_->path, [&] {
    std::vector<Result> newest;
    SQLite::Statement row(
        *impl_->database,
        "SELECT r.kind, r.created_utc, r.json FROM (SELECT min(rowid) AS first, max(rowid) AS last"
        " FROM result GROUP BY kind) k JOIN result r ON r.rowid = k.last ORDER BY k.first");
    while (row.executeStep())
      newest.push_back(
          {row.getColumn(0).getString(), row.getColumn(1).getString(), row.getColumn(2).getString()});
    return newest;
  });
}

void SessionStore::add_event(std::int64_t host_us, const std::string& level, const std::string& text) {
  if (impl_->open_capture) {
    impl_->waiting_events.push_back({host_us, level, text});
    return;
  }
  guarded(impl_->path, [&] { impl_->write_event({host_us, level, text}); });
}

std::vector<SessionStore::Event> SessionStore::events() const {
  return guarded(impl_->path, [&] {
    std::vector<Event> all;
    SQLite::Statement row(*impl_->database, "SELECT host_us, level, text FROM event ORDER BY rowid");
    while (row.executeStep())
      all.push_back(
          {row.getColumn(0).getInt64(), row.getColumn(1).getString(), row.getColumn(2).getString()});
    all.insert(all.end(), impl_->waiting_events.begin(), impl_->waiting_events.end());
    return all;
  });
}

std::unique_ptr<fit::Recording> SessionStore::recording(const std::optional<fit::Bench>& bench) const {
  if (impl_->mode != Mode::read && !impl_->open_capture) guarded(impl_->path, [&] { impl_->flush(); });
  std::optional<fit::Bench> known = bench;
  if (!known) {
    const auto text = get("bench");
    if (!text) throw UsageError(impl_->path + " holds no bench. Give one with --bench FILE.");
    try {
      known = fit::parse_bench(*text, impl_->path + " (its bench)");
    } catch (const std::invalid_argument& error) {
      throw UsageError(error.what());
    }
  }
  return guarded(impl_->path, [&]() -> std::unique_ptr<fit::Recording> {
    return std::make_unique<StoredRecording>(*impl_->database, impl_->path, std::move(*known));
  });
}

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
    if (impl_->mode != Mode::read && !impl_->open_capture) impl_->flush();
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

bool is_session_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw UsageError("cannot open " + path + ": check the name and the permission");
  std::string head(15, '\0');
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  return head == "SQLite format 3" || path.ends_with(".rig");
}

}  // namespace rig
