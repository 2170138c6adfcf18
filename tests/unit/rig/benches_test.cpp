// SPDX-License-Identifier: MIT
// Several benches on one computer: locks by address and identity, and one page of all of them.
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <csignal>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rig/errors.hpp"
#include "rig/live/benches_state.hpp"
#include "rig/runner/device_lock.hpp"
#include "rig/session/session_store.hpp"
#include "rig/session/standing.hpp"
#include "tests/support/calibrations.hpp"
#include "tests/support/test_folder.hpp"

namespace benches_test {
namespace {

using Catch::Contains;
using nlohmann::json;

/// Locks of this test alone.
struct LocksFolder {
  TestFolder folder;
  LocksFolder() { ::setenv("RIG_LOCKS", (folder / "locks").c_str(), 1); }
  ~LocksFolder() { ::unsetenv("RIG_LOCKS"); }
};

const json real_lidar = {
    {"VV", {{"VEND", "Hokuyo Automatic Co., Ltd."}, {"PROD", "UST-10LX"}, {"SERI", "H123"}}}};
const json simulated_lidar = {
    {"VV", {{"VEND", "rig-sim: simulated"}, {"PROD", "UST-10LX"}, {"SERI", "H123"}}}};

}  // namespace

TEST_CASE("device locks: one device has one run, by address and by serial number, until that run ends") {
  const LocksFolder locks;
  {
    rig::DeviceLocks first("session a.rig");
    first.lock("lidar", "192.168.0.10:10940");
    first.lock("lidar", "192.168.0.10:10940");  // One's own is no obstacle.
    first.lock_lidar(real_lidar);
    first.lock_stage("X-RSW60A", "10234");
    rig::DeviceLocks second("session b.rig");
    CHECK_THROWS_WITH(second.lock("lidar", "192.168.0.10:10940"),
                      Contains("in use") && Contains("session a.rig"));
    CHECK_THROWS_AS(second.lock_lidar(real_lidar), rig::DeviceError);  // By another address.
    CHECK_THROWS_AS(second.lock_stage("X-RSW60A", "10234"), rig::DeviceError);
    CHECK_NOTHROW(second.lock("lidar", "192.168.0.11:10940"));
    CHECK_NOTHROW(second.lock_stage("X-RSW60A", "10235"));
    CHECK_NOTHROW(first.lock_lidar(simulated_lidar));
    CHECK_NOTHROW(second.lock_lidar(simulated_lidar));  // All simulated ones have one number.
    CHECK_NOTHROW(second.lock_stage("X-RSW60A", ""));
  }
  rig::DeviceLocks third("session c.rig");
  CHECK_NOTHROW(third.lock_lidar(real_lidar));
  CHECK_NOTHROW(third.lock("lidar", "../../etc/passwd"));
  CHECK_FALSE(std::filesystem::exists(locks.folder / "etc"));
}

TEST_CASE(
    "device locks: a program that is killed leaves nothing locked; where nothing can be locked, runs go on") {
  const LocksFolder locks;
  int ready[2];
  REQUIRE(::pipe(ready) == 0);
  const pid_t child = ::fork();
  if (child == 0) {
    rig::DeviceLocks held("session of the child");
    held.lock("lidar", "one");
    (void)!::write(ready[1], "x", 1);
    ::pause();
    ::_exit(0);
  }
  char byte = 0;
  REQUIRE(::read(ready[0], &byte, 1) == 1);
  rig::DeviceLocks mine("mine");
  CHECK_THROWS_WITH(mine.lock("lidar", "one"),
                    Contains("session of the child, process " + std::to_string(child)));
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  CHECK_NOTHROW(mine.lock("lidar", "one"));
  ::setenv("RIG_LOCKS", "/proc/no-place-for-locks", 1);
  rig::DeviceLocks nowhere("nowhere");
  CHECK_NOTHROW(nowhere.lock("lidar", "one"));
}

TEST_CASE(
    "benches: who waits for a person comes first, then what was killed, what runs, what ended; nothing is "
    "changed") {
  const TestFolder folder;
  Calibration done;
  done.write(folder / "old/done.rig");
  rig::SessionStore running(folder / "running.rig", rig::SessionStore::Mode::create);
  running.set("bench", R"({"schema":"bench/1","name":"bench B"})");
  running.set("steps", R"([{"key":"1","text":"home"},{"key":"2","text":"capture"}])");
  running.set("live_page", "http://127.0.0.1:8080/");
  running.set_progress("1", "{}");
  rig::SessionStore waiting(folder / "waiting.rig", rig::SessionStore::Mode::create);
  waiting.set("waiting", R"({"title":"Place the board","text":"At 1.4 m","since_unix_s":1000})");
  waiting.set("lidar", R"({"PROD":"UST-10LX","SERI":"H9"})");
  {
    rig::SessionStore was(folder / "was.rig", rig::SessionStore::Mode::create);
    was.set("bench", R"({"schema":"bench/1"})");
    // As a kill leaves it: the log is there, and nobody holds the lock.
    std::filesystem::copy(folder / "was.rig", folder / "killed.rig");
    std::filesystem::copy(folder / "was.rig-wal", folder / "killed.rig-wal");
  }
  {
    // Killed, and made one file again by whoever opened it since.
    rig::SessionStore opened(folder / "opened.rig", rig::SessionStore::Mode::create);
    opened.set("ended", "");
    rig::SessionStore reporting(folder / "reporting.rig", rig::SessionStore::Mode::create);
    reporting.set("ended", rig::ended_but_for_reports);
  }
  const auto names = folder.names();
  rig::BenchesState benches(folder.path());
  const json state = benches.observe(1600);
  REQUIRE(state.at("benches").size() == 7);
  const json &first = state.at("benches").at(0), &fifth = state.at("benches").at(4);
  CHECK(first.at("session") == "waiting.rig");
  CHECK(first.at("phase") == "needs an operator");
  CHECK(first.at("needs").at("title") == "Place the board");
  CHECK(first.at("needs").at("waiting_s") == 600);
  CHECK(first.at("lidar") == "UST-10LX H9");
  CHECK(fifth.at("session") == "running.rig");
  CHECK(fifth.at("step") == json{{"n", 1}, {"of", 2}, {"text", "capture"}});
  CHECK(fifth.at("live_page") == "http://127.0.0.1:8080/");
  for (const json& bench : state.at("benches")) {
    INFO(bench);
    const std::string file = bench.at("session");
    const bool killed = file == "opened.rig" || file == "reporting.rig" || file == "killed.rig";
    CHECK((bench.at("phase") == "stopped") == killed);
    CHECK((bench.at("phase") == "done") == (file == "old/done.rig" || file == "was.rig"));
    if (killed) CHECK_THAT(bench.at("says"), Contains("rig resume"));
  }
  CHECK(state.at("needed") == 1);
  CHECK(state.at("running") == 2);
  CHECK(folder.names() == names);
  waiting.set("waiting", "");
  CHECK(benches.observe(1601).at("needed") == 0);
  CHECK_THROWS_AS(rig::BenchesState(folder / "nowhere").observe(0), rig::UsageError);
}

}  // namespace benches_test
