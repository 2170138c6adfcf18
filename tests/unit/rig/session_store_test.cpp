// SPDX-License-Identifier: MIT
#include "rig/session/session_store.hpp"

#include <SQLiteCpp/SQLiteCpp.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <random>

#include "rig/errors.hpp"
#include "rig/session/session_file.hpp"
#include "rig/session/sha256.hpp"
#include "tests/support/test_folder.hpp"

namespace session_store_test {

using rig::SessionStore;
using Mode = rig::SessionStore::Mode;

namespace {

const std::optional<fit::Bench>& plain_bench() {
  static std::optional<fit::Bench> bench;
  if (!bench) bench.emplace();
  return bench;
}

fit::CaptureInfo small_capture() {
  fit::CaptureInfo info;
  info.step = "look";
  info.started_us = 123;
  info.stage_rad = 0.3 * fit::rad_per_deg;
  info.stage_readback_rad = 0.31 * fit::rad_per_deg;
  info.approach = 1;
  info.target = "board";
  info.target_shift_mm = 100;
  info.reflectance = 0.5;
  info.first_step = 10;
  info.last_step = 12;
  return info;
}

fit::ScanView scan_of(std::int64_t seq, const std::vector<std::uint16_t>& ranges,
                      const std::vector<std::uint16_t>& intensities = {}) {
  fit::ScanView scan;
  scan.seq = seq;
  scan.device_ms = 25 * seq;
  scan.host_us = 25'000 * seq;
  scan.range_mm = ranges;
  scan.intensity = intensities;
  return scan;
}

void add_capture(SessionStore& store, int scans) {
  const auto id = store.begin_capture(small_capture());
  for (int i = 0; i < scans; ++i) store.add_scan(id, scan_of(i, {1, 2, 65535}));
  store.commit_capture(id);
}

}  // namespace

TEST_CASE("SHA-256 by the processor's instructions is that by the portable code") {
  std::mt19937 random(5);
  std::vector<std::uint8_t> bytes(64 * 40);
  for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
  for (std::size_t blocks = 1; blocks <= 40; ++blocks) {
    rig::Sha256State fast{}, plain{};
    for (std::size_t i = 0; i < 8; ++i) fast[i] = plain[i] = static_cast<std::uint32_t>(random());
    rig::fastest_digest()(fast, bytes.data(), blocks);
    rig::portable_digest()(plain, bytes.data(), blocks);
    CHECK(fast == plain);
  }
}

TEST_CASE("SHA-256 gives the digests of FIPS 180-4") {
  rig::Sha256 empty;
  CHECK(empty.hex() == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  rig::Sha256 abc;
  abc.feed("abc");
  CHECK(abc.hex() == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  rig::Sha256 million;
  for (int i = 0; i < 1000; ++i) million.feed(std::string(1000, 'a'));
  CHECK(million.hex() == "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST_CASE("a capture comes back as it was written") {
  const TestFolder folder;
  {
    SessionStore store(folder / "run.rig", Mode::create);
    auto info = small_capture();
    info.stage_rate_rad_s = 10 * fit::rad_per_deg;
    const auto id = store.begin_capture(info);
    store.add_scan(id, scan_of(0, {100, 0, 65535}, {7, 8, 9}));
    const std::vector<std::uint16_t> five = {1, 2, 3, 4, 5};
    auto own = scan_of(1, five);
    own.geometry = fit::ScanGeometry{0.1, 0.01, 0.2};
    store.add_scan(id, own);
    store.add_pose({5, 1.0, 2.0, 0.5, {}, {}, {}});
    store.commit_capture(id);
  }
  const SessionStore store(folder / "run.rig", Mode::read);
  const auto recording = store.recording(plain_bench());
  REQUIRE(recording->captures().size() == 1);
  const auto& info = recording->captures()[0];
  CHECK(info.step == "look");
  CHECK(info.started_us == 123);
  CHECK(info.stage_rad == Approx(0.3 * fit::rad_per_deg).epsilon(1e-14));
  CHECK(*info.stage_readback_rad == Approx(0.31 * fit::rad_per_deg).epsilon(1e-14));
  CHECK(info.approach == 1);
  CHECK(info.target == "board");
  CHECK(info.target_shift_mm == 100);
  CHECK(info.reflectance == 0.5);
  CHECK_FALSE(info.temperature_c);
  CHECK(info.stage_rate_rad_s == Approx(10 * fit::rad_per_deg));
  CHECK(info.beams() == 3);
  std::vector<std::vector<std::uint16_t>> ranges, intensities;
  std::vector<bool> own;
  recording->for_each_scan(0, [&](const fit::ScanView& scan) {
    ranges.emplace_back(scan.range_mm.begin(), scan.range_mm.end());
    intensities.emplace_back(scan.intensity.begin(), scan.intensity.end());
    own.push_back(scan.geometry.has_value());
    CHECK(scan.device_ms == 25 * scan.seq);
  });
  CHECK(ranges == std::vector<std::vector<std::uint16_t>>{{100, 0, 65535}, {1, 2, 3, 4, 5}});
  CHECK(intensities == std::vector<std::vector<std::uint16_t>>{{7, 8, 9}, {}});
  CHECK(own == std::vector<bool>{false, true});
  REQUIRE(recording->track().size() == 1);
  CHECK(recording->track()[0].heading_rad == Approx(0.5).epsilon(1e-9));
  CHECK_FALSE(recording->track()[0].stage_rad);
}

TEST_CASE("the file is what formats.md says: degrees, little-endian blobs, application id") {
  const TestFolder folder;
  {
    SessionStore store(folder / "run.rig", Mode::create);
    const auto id = store.begin_capture(small_capture());
    store.add_scan(id, scan_of(0, {0x0102, 0, 0xfffe}));
    store.commit_capture(id);
  }
  SQLite::Database database(folder / "run.rig", SQLite::OPEN_READONLY);
  CHECK(database.execAndGet("PRAGMA application_id").getInt() == 0x52494731);
  CHECK(database.execAndGet("PRAGMA user_version").getInt() == 1);
  CHECK(database.execAndGet("SELECT stage_deg FROM capture").getDouble() == 0.3);
  CHECK(database.execAndGet("SELECT hex(range_mm) FROM scan").getString() == "02010000FEFF");
  CHECK(database.execAndGet("SELECT intensity IS NULL FROM scan").getInt() == 1);
  CHECK(database.execAndGet("PRAGMA journal_mode").getString() == "delete");
}

TEST_CASE("an abandoned capture leaves nothing but its events") {
  const TestFolder folder;
  SessionStore store(folder / "run.rig", Mode::create);
  const auto id = store.begin_capture(small_capture());
  store.add_scan(id, scan_of(0, {1, 2, 3}));
  store.set_progress("look", "{}");
  store.add_event(1, "error", "lidar lost");
  store.abandon_capture(id);
  CHECK(store.recording(plain_bench())->captures().empty());
  CHECK(store.progress().empty());
  REQUIRE(store.events().size() == 1);
  CHECK(store.events()[0].text == "lidar lost");
}

TEST_CASE("a commit that the disk refuses costs the capture, and neither events nor poses nor keys") {
  const TestFolder folder;
  const std::string file = folder / "run.rig";
  {
    SessionStore store(file, Mode::create);
    store.set("lidar_restarts", "[]");
    const auto id = store.begin_capture(small_capture());
    for (int i = 0; i < 1000; ++i) store.add_scan(id, scan_of(i, {1, 2, 3}));
    store.add_event(1, "error", "lidar lost");
    store.set("lidar_restarts", "[1]");
    CHECK(store.get("lidar_restarts") == "[1]");
    for (int i = 0; i < 5000; ++i) {  // More than are written at a time.
      fit::TrackPose pose;
      pose.host_us = i;
      store.add_pose(pose);
    }
    const auto before = std::signal(SIGXFSZ, SIG_IGN);
    rlimit whole{}, full{};
    ::getrlimit(RLIMIT_FSIZE, &whole);
    full = whole, full.rlim_cur = 4096;
    ::setrlimit(RLIMIT_FSIZE, &full);
    CHECK_THROWS(store.commit_capture(id));
    ::setrlimit(RLIMIT_FSIZE, &whole);
    std::signal(SIGXFSZ, before);
    CHECK_NOTHROW(store.abandon_capture(id));
    store.finish();
  }
  const SessionStore store(file, Mode::read);
  CHECK(store.captures().empty());
  CHECK(store.events().size() == 1);
  CHECK(store.get("lidar_restarts") == "[1]");
  CHECK(store.recording(plain_bench())->track().size() == 5000);
}

TEST_CASE("a key that is set while a capture is written outlives its end") {
  const TestFolder folder;
  SessionStore store(folder / "run.rig", Mode::create);
  const auto id = store.begin_capture(small_capture());
  store.set("lidar_accepted", "yes");
  store.abandon_capture(id);
  const SessionStore beside(folder / "run.rig", Mode::read);
  CHECK(beside.get("lidar_accepted") == "yes");
}

TEST_CASE("a reader beside the writer sees only captures that are committed") {
  const TestFolder folder;
  SessionStore writer(folder / "run.rig", Mode::create);
  add_capture(writer, 2);
  const auto id = writer.begin_capture(small_capture());
  writer.add_scan(id, scan_of(0, {1, 2, 3}));
  const SessionStore reader(folder / "run.rig", Mode::read);
  CHECK(reader.recording(plain_bench())->captures().size() == 1);
  writer.commit_capture(id);
  CHECK(reader.recording(plain_bench())->captures().size() == 2);
}

TEST_CASE("a writer that is killed in a capture loses that capture and nothing before it") {
  const TestFolder folder;
  const pid_t child = fork();
  if (child == 0) {
    SessionStore store(folder / "run.rig", Mode::create);
    add_capture(store, 3);
    store.set_progress("first", "{}");
    const auto id = store.begin_capture(small_capture());
    for (int i = 0; i < 2000; ++i) store.add_scan(id, scan_of(i, {1, 2, 3}));
    store.set_progress("second", "{}");
    raise(SIGKILL);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  REQUIRE(WIFSIGNALED(status));
  SessionStore store(folder / "run.rig", Mode::append);
  CHECK(store.recording(plain_bench())->captures().size() == 1);
  CHECK(store.progress().count("first") == 1);
  CHECK(store.progress().count("second") == 0);
  add_capture(store, 1);
  CHECK(store.recording(plain_bench())->captures().size() == 2);
}

TEST_CASE(
    "a session whose writer was killed is one file again for whoever opens it, and a copy without its log "
    "lacks little") {
  const TestFolder folder;
  const std::string file = folder / "run.rig";
  const pid_t child = fork();
  if (child == 0) {
    SessionStore store(file, Mode::create);
    for (int i = 0; i < 20; ++i) add_capture(store, 3);
    raise(SIGKILL);
  }
  REQUIRE(waitpid(child, nullptr, 0) == child);
  REQUIRE(std::filesystem::exists(file + "-wal"));
  CHECK_THAT(rig::words_about_log(file),
             Catch::Contains("has a log beside it") && Catch::Contains("copy both together"));
  std::filesystem::copy(file, folder / "copy.rig");
  CHECK_THAT(rig::words_about_log(folder / "copy.rig"), Catch::Contains("copy the log too"));
  CHECK(SessionStore(folder / "copy.rig", Mode::read).captures().size() == 20);

  CHECK(SessionStore(file, Mode::read).captures().size() == 20);
  CHECK_FALSE(std::filesystem::exists(file + "-wal"));
  CHECK(rig::words_about_log(file).empty());
  // Beside a writer nothing is changed.
  SessionStore writer(file, Mode::append);
  add_capture(writer, 1);
  CHECK(SessionStore(file, Mode::read).captures().size() == 21);
  add_capture(writer, 1);
  CHECK(SessionStore(file, Mode::read).captures().size() == 22);
}

TEST_CASE("files that are no sessions are refused in words") {
  const TestFolder folder;
  using Catch::Matchers::Contains;
  CHECK_THROWS_WITH(SessionStore(folder / "none.rig", Mode::read), Contains("no such session file"));
  std::ofstream(folder / "text.rig") << std::string(5000, 'x');
  CHECK_THROWS_WITH(SessionStore(folder / "text.rig", Mode::read), Contains("not a session file"));
  {
    SQLite::Database(folder / "other.rig", SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE)
        .exec("CREATE TABLE t(x)");
  }
  CHECK_THROWS_WITH(SessionStore(folder / "other.rig", Mode::read), Contains("not a session file of rig"));
  { std::ofstream(folder / "empty.rig"); }
  CHECK_THROWS_WITH(SessionStore(folder / "empty.rig", Mode::read), Contains("is empty"));
  { SessionStore(folder / "later.rig", Mode::create); }
  { SQLite::Database(folder / "later.rig", SQLite::OPEN_READWRITE).exec("PRAGMA user_version = 2"); }
  CHECK_THROWS_WITH(SessionStore(folder / "later.rig", Mode::read), Contains("later version"));
  CHECK_THROWS_AS(SessionStore(folder / "later.rig", Mode::append), rig::UsageError);
}

TEST_CASE("a session is never overwritten and never written by two at once") {
  const TestFolder folder;
  using Catch::Matchers::Contains;
  SessionStore store(folder / "run.rig", Mode::create);
  CHECK_THROWS_WITH(SessionStore(folder / "run.rig", Mode::create), Contains("exists already"));
  CHECK_THROWS_WITH(SessionStore(folder / "run.rig", Mode::append), Contains("another program"));
}

TEST_CASE("a session that is removed while it is written is saved under another name, and that is reported") {
  const TestFolder folder;
  {
    SessionStore store(folder / "run.rig", Mode::create);
    for (const bool removed : {false, true}) {
      const auto id = store.begin_capture(small_capture());
      store.add_scan(id, scan_of(0, {1, 2, 3}));
      if (removed) {
        std::filesystem::remove(folder / "run.rig");
        CHECK_THROWS_WITH(store.commit_capture(id), Catch::Matchers::Contains("was removed") &&
                                                        Catch::Matchers::Contains("run.rig.rescued"));
      } else {
        store.commit_capture(id);
      }
    }
  }
  CHECK_FALSE(std::filesystem::exists(folder / "run.rig"));
  const SessionStore rescued(folder / "run.rig.rescued", Mode::append);
  CHECK(rescued.recording(plain_bench())->captures().size() == 2);
}

TEST_CASE(
    "a session that is removed after its last capture is saved under another name when it is finished") {
  const TestFolder folder;
  const bool replaced = GENERATE(false, true);
  {
    SessionStore store(folder / "run.rig", Mode::create);
    for (int i = 0; i < 2; ++i) {
      const auto id = store.begin_capture(small_capture());
      store.add_scan(id, scan_of(0, {1, 2, 3}));
      store.commit_capture(id);
    }
    store.add_result("range", "{}");
    std::filesystem::remove(folder / "run.rig");
    if (replaced) std::ofstream(folder / "run.rig") << "something else";
    CHECK_THROWS_WITH(store.finish(), Catch::Matchers::Contains("run.rig.rescued"));
    CHECK_NOTHROW(store.finish());
  }
  // As the words say: renamed, it is the session; nothing of the removed one's log comes into it.
  std::filesystem::rename(folder / "run.rig.rescued", folder / "run.rig");
  CHECK_FALSE(std::filesystem::exists(folder / "run.rig-wal"));
  const SessionStore store(folder / "run.rig", Mode::append);
  CHECK(store.recording(plain_bench())->captures().size() == 2);
  CHECK(store.latest_result("range").value_or("") == "{}");
}

TEST_CASE("a finished session is one plain file while its writer is still there") {
  const TestFolder folder;
  SessionStore store(folder / "run.rig", Mode::create);
  add_capture(store, 1);
  store.finish();
  CHECK_FALSE(std::filesystem::exists(folder / "run.rig-wal"));
  CHECK(SessionStore(folder / "run.rig", Mode::read).recording(plain_bench())->captures().size() == 1);
}

TEST_CASE("damaged scans are refused rather than misread") {
  const TestFolder folder;
  {
    SessionStore store(folder / "run.rig", Mode::create);
    add_capture(store, 1);
  }
  { SQLite::Database(folder / "run.rig", SQLite::OPEN_READWRITE).exec("UPDATE scan SET range_mm = x'0102'"); }
  const SessionStore store(folder / "run.rig", Mode::read);
  CHECK_THROWS_WITH(store.recording(plain_bench())->for_each_scan(0, [](const fit::ScanView&) {}),
                    Catch::Matchers::Contains("holds 1 values where 3"));
}

TEST_CASE("a session that was cut in half is refused with a way to save what is left") {
  const TestFolder folder;
  {
    SessionStore store(folder / "run.rig", Mode::create);
    for (int i = 1; i <= 200; ++i) add_capture(store, i);
  }
  std::filesystem::resize_file(folder / "run.rig", std::filesystem::file_size(folder / "run.rig") / 2);
  const auto use = [&] {
    const SessionStore store(folder / "run.rig", Mode::read);
    store.recording(plain_bench())->for_each_scan(0, [](const fit::ScanView&) {});
    (void)store.content_hash();
  };
  CHECK_THROWS_WITH(use(), Catch::Matchers::Contains("sqlite3 -readonly FILE .dump") &&
                               Catch::Matchers::Contains("PRAGMA application_id=1380534065;"));
}

TEST_CASE("the content hash names the data and not how it was written") {
  const TestFolder folder;
  for (const char* name : {"a.rig", "b.rig", "c.rig"}) {
    SessionStore store(folder / name, Mode::create);
    store.set("bench", "{}");
    store.set("software", name);
    add_capture(store, name == std::string("c.rig") ? 2 : 1);
  }
  const auto hash = [&](const char* name) { return SessionStore(folder / name, Mode::read).content_hash(); };
  CHECK(hash("a.rig").size() == 64);
  CHECK(hash("a.rig") == hash("b.rig"));
  CHECK(hash("a.rig") != hash("c.rig"));
}

TEST_CASE("the newest result of a kind is the one that counts") {
  const TestFolder folder;
  SessionStore store(folder / "run.rig", Mode::create);
  CHECK_FALSE(store.latest_result("centre"));
  store.add_result("centre", "1");
  store.add_result("centre", "2");
  CHECK(store.latest_result("centre") == "2");
  store.add_result("range", "3");
  store.add_result("centre", "4");
  const auto newest = store.latest_results();
  REQUIRE(newest.size() == 2);
  CHECK(newest[0].json == "4");
  CHECK(newest[1].kind == "range");
}

}  // namespace session_store_test
