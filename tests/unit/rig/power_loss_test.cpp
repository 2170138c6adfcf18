// SPDX-License-Identifier: MIT
// What a session holds after the power fails: a layer between SQLite and the disk remembers every write and
// every flush; afterwards any moment can be replayed with what was not flushed lost, torn or reordered.
#include <sqlite3.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <sstream>

#include "rig/errors.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/test_folder.hpp"

namespace power_loss_test {
namespace {

namespace fs = std::filesystem;

struct Operation {
  enum class Kind { write, truncate, flush, remove };
  Kind kind;
  std::string file;
  std::int64_t offset = 0;
  std::string bytes;
};
std::vector<Operation> journal;

struct Watched {
  sqlite3_file base;
  sqlite3_file* real;
  const char* name;
};
Watched* watched(sqlite3_file* file) { return reinterpret_cast<Watched*>(file); }
sqlite3_file* real(sqlite3_file* file) { return watched(file)->real; }
sqlite3_vfs* disk() {
  static sqlite3_vfs* const found = sqlite3_vfs_find("unix");
  return found;
}

int close_file(sqlite3_file* f) {
  const int result = real(f)->pMethods->xClose(real(f));
  sqlite3_free(real(f));
  return result;
}
int read_file(sqlite3_file* f, void* to, int size, sqlite3_int64 at) {
  return real(f)->pMethods->xRead(real(f), to, size, at);
}
int write_file(sqlite3_file* f, const void* from, int size, sqlite3_int64 at) {
  journal.push_back({Operation::Kind::write, watched(f)->name, at,
                     std::string(static_cast<const char*>(from), static_cast<std::size_t>(size))});
  return real(f)->pMethods->xWrite(real(f), from, size, at);
}
int truncate_file(sqlite3_file* f, sqlite3_int64 size) {
  journal.push_back({Operation::Kind::truncate, watched(f)->name, size, ""});
  return real(f)->pMethods->xTruncate(real(f), size);
}
int flush_file(sqlite3_file* f, int flags) {
  journal.push_back({Operation::Kind::flush, watched(f)->name, 0, ""});
  return real(f)->pMethods->xSync(real(f), flags);
}
int file_size(sqlite3_file* f, sqlite3_int64* size) { return real(f)->pMethods->xFileSize(real(f), size); }
int lock_file(sqlite3_file* f, int level) { return real(f)->pMethods->xLock(real(f), level); }
int unlock_file(sqlite3_file* f, int level) { return real(f)->pMethods->xUnlock(real(f), level); }
int check_lock(sqlite3_file* f, int* out) { return real(f)->pMethods->xCheckReservedLock(real(f), out); }
int control(sqlite3_file* f, int op, void* arg) { return real(f)->pMethods->xFileControl(real(f), op, arg); }
int sector(sqlite3_file*) { return 512; }
int traits(sqlite3_file*) { return 0; }
int shm_map(sqlite3_file* f, int page, int size, int extend, void volatile** out) {
  return real(f)->pMethods->xShmMap(real(f), page, size, extend, out);
}
int shm_lock(sqlite3_file* f, int at, int n, int flags) {
  return real(f)->pMethods->xShmLock(real(f), at, n, flags);
}
void shm_barrier(sqlite3_file* f) { real(f)->pMethods->xShmBarrier(real(f)); }
int shm_unmap(sqlite3_file* f, int remove) { return real(f)->pMethods->xShmUnmap(real(f), remove); }

const sqlite3_io_methods methods = {2,           close_file, read_file, write_file,  truncate_file,
                                    flush_file,  file_size,  lock_file, unlock_file, check_lock,
                                    control,     sector,     traits,    shm_map,     shm_lock,
                                    shm_barrier, shm_unmap,  nullptr,   nullptr};

int open_file(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* out) {
  Watched* self = watched(file);
  self->base.pMethods = nullptr;
  self->name = name;
  self->real = static_cast<sqlite3_file*>(sqlite3_malloc(disk()->szOsFile));
  std::memset(self->real, 0, static_cast<std::size_t>(disk()->szOsFile));
  const int result = disk()->xOpen(disk(), name, self->real, flags, out);
  if (result == SQLITE_OK)
    self->base.pMethods = &methods;
  else
    sqlite3_free(self->real);
  return result;
}
int remove_file(sqlite3_vfs*, const char* name, int flush) {
  journal.push_back({Operation::Kind::remove, name, flush, ""});
  return disk()->xDelete(disk(), name, flush);
}

/// Every database of this process goes through the layer while one of these lives.
class WatchedDisk {
 public:
  WatchedDisk() {
    layer_ = *disk();
    layer_.zName = "watched";
    layer_.szOsFile = sizeof(Watched);
    layer_.xOpen = open_file;
    layer_.xDelete = remove_file;
    sqlite3_vfs_register(&layer_, 1);
    journal.clear();
  }
  ~WatchedDisk() {
    sqlite3_vfs_unregister(&layer_);
    sqlite3_vfs_register(disk(), 1);
  }

 private:
  sqlite3_vfs layer_{};
};

using Files = std::map<std::string, std::string>;

void apply(Files& files, const Operation& op, std::size_t bytes) {
  std::string& text = files[op.file];
  const auto at = static_cast<std::size_t>(op.offset);
  switch (op.kind) {
    case Operation::Kind::write:
      if (text.size() < at + bytes) text.resize(at + bytes, '\0');
      text.replace(at, bytes, op.bytes, 0, bytes);
      break;
    case Operation::Kind::truncate:
      text.resize(at);
      break;
    case Operation::Kind::remove:
      files.erase(op.file);
      break;
    case Operation::Kind::flush:
      break;
  }
}

/// The disk after the power failed before operation `end`: what was flushed is there; of the rest each write
/// is there whole, in part (whole sectors) or not at all.
Files after_power_loss(const Files& before, std::size_t end, std::mt19937& random) {
  std::map<std::string, std::size_t> flushed;
  for (std::size_t i = 0; i < end; ++i)
    if (journal[i].kind == Operation::Kind::flush) flushed[journal[i].file] = i;
  Files files = before;
  for (std::size_t i = 0; i < end; ++i) {
    const Operation& op = journal[i];
    const bool safe = (flushed.count(op.file) && i < flushed[op.file]) ||
                      (op.kind == Operation::Kind::remove && op.offset != 0);  // The folder was flushed.
    const unsigned fate = safe ? 0 : random() % 3;
    if (fate == 2) continue;
    const std::size_t part = op.bytes.empty() ? 0 : random() % op.bytes.size() / 512 * 512;
    apply(files, op, fate == 0 ? op.bytes.size() : part);
  }
  return files;
}

std::string content(const std::string& path) {
  std::stringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

fit::ScanView scan_of(std::int64_t seq, std::vector<std::uint16_t>& values) {
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = static_cast<std::uint16_t>(seq * 31 + static_cast<std::int64_t>(i));
  fit::ScanView view;
  view.seq = seq;
  view.range_mm = values;
  return view;
}

/// How many captures are whole and right; throws if one is not, or the file cannot be opened.
std::size_t whole_captures(const std::string& path) {
  const rig::SessionStore session(path, rig::SessionStore::Mode::append);
  const auto recording = session.recording();
  const auto progress = session.progress();
  for (std::size_t i = 0; i < recording->captures().size(); ++i) {
    std::int64_t seq = 0;
    std::vector<std::uint16_t> wanted(200);
    recording->for_each_scan(i, [&](const fit::ScanView& scan) {
      const auto right = scan_of(100 * static_cast<std::int64_t>(i) + seq, wanted);
      if (!std::ranges::equal(right.range_mm, scan.range_mm)) throw std::runtime_error("a scan is wrong");
      ++seq;
    });
    if (seq != 20) throw std::runtime_error("a capture is not whole");
  }
  if (progress.size() != recording->captures().size())
    throw std::runtime_error("progress and captures do not agree");
  return recording->captures().size();
}

}  // namespace

TEST_CASE("whenever the power fails, every capture whose commit had returned is whole") {
  const TestFolder folder;
  const std::string path = folder / "run.rig";
  {
    rig::SessionStore made(path, rig::SessionStore::Mode::create);
    made.set("bench", R"({"schema": "bench/1"})");
  }
  const Files before = {{path, content(path)}};
  std::vector<std::size_t> committed;  // Operations done when each commit returned.
  {
    const WatchedDisk disk_layer;
    rig::SessionStore session(path, rig::SessionStore::Mode::append);
    std::vector<std::uint16_t> values(200);
    for (int capture = 0; capture < 12; ++capture) {
      fit::CaptureInfo info;
      info.last_step = 199;
      const auto id = session.begin_capture(info);
      for (int i = 0; i < 20; ++i) {
        auto scan = scan_of(100 * capture + i, values);
        scan.seq = i;
        session.add_scan(id, scan);
      }
      session.set_progress("step " + std::to_string(capture), "{}");
      session.commit_capture(id);
      committed.push_back(journal.size());
      session.add_event(capture, "info", "between captures");
    }
  }
  REQUIRE(journal.size() > 50);

  std::mt19937 random(1);
  for (int trial = 0; trial < 300; ++trial) {
    const std::size_t end = random() % (journal.size() + 1);
    const auto promised = static_cast<std::size_t>(
        std::ranges::count_if(committed, [&](std::size_t count) { return count <= end; }));
    for (const auto& entry : fs::directory_iterator(folder.path())) fs::remove(entry);
    for (const auto& [name, text] : after_power_loss(before, end, random))
      std::ofstream(name, std::ios::binary) << text;
    INFO("power fails before operation " << end << " of " << journal.size());
    std::size_t found = 0;
    REQUIRE_NOTHROW(found = whole_captures(path));
    CHECK(found >= promised);
    CHECK(found <= promised + 1);
  }
}

TEST_CASE("a session with any of its bytes spoilt is read or refused in words, never worse") {
  const TestFolder folder;
  const std::string path = folder / "run.rig";
  {
    rig::SessionStore session(path, rig::SessionStore::Mode::create);
    session.set("bench", R"({"schema": "bench/1"})");
    std::vector<std::uint16_t> values(200);
    for (int capture = 0; capture < 3; ++capture) {
      fit::CaptureInfo info;
      info.last_step = 199;
      const auto id = session.begin_capture(info);
      for (int i = 0; i < 20; ++i) session.add_scan(id, scan_of(i, values));
      session.commit_capture(id);
    }
  }
  const std::string good = content(path);
  std::mt19937 random(2);
  int refused = 0;
  for (int trial = 0; trial < 300; ++trial) {
    std::string bad = good;
    const int spoilt = 1 + static_cast<int>(random() % 20);
    for (int i = 0; i < spoilt; ++i)
      bad[random() % (trial % 2 ? 4096 : bad.size())] = static_cast<char>(random());
    if (trial % 5 == 0) bad.resize(random() % bad.size());
    std::ofstream(path, std::ios::binary) << bad;
    try {
      const rig::SessionStore session(path, rig::SessionStore::Mode::read);
      const auto recording = session.recording();
      std::size_t values = 0;
      for (std::size_t i = 0; i < recording->captures().size(); ++i)
        recording->for_each_scan(i, [&](const fit::ScanView& scan) { values += scan.range_mm.size(); });
      (void)session.latest_results();
      (void)session.events();
    } catch (const rig::UsageError& error) {
      ++refused;
      CHECK(std::string(error.what()).find(path) != std::string::npos);
    } catch (const rig::MeasurementError&) {
      ++refused;
    }
  }
  CHECK(refused > 20);
}

}  // namespace power_loss_test
