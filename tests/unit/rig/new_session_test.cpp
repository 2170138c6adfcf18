// SPDX-License-Identifier: MIT
#include "rig/session/new_session.hpp"

#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <set>

#include "rig/errors.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/test_folder.hpp"

namespace new_session_test {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;
using rig::SessionStore;

void fill(const std::string& path) {
  SessionStore store(path, SessionStore::Mode::create);
  store.set("bench", R"({"schema": "bench/1"})");
  store.finish();
}

}  // namespace

TEST_CASE("a new session appears under its name when it is whole") {
  const TestFolder folder;
  const std::string path = folder / "new.rig";
  rig::make_session(rig::check_output({path}), [&](const std::string& unfinished) {
    CHECK(fs::path(unfinished).parent_path() == folder.path());
    fill(unfinished);
    CHECK_FALSE(fs::exists(path));
  });
  CHECK(SessionStore(path, SessionStore::Mode::read).get("bench").has_value());
  CHECK(folder.names() == std::set<std::string>{"new.rig"});
}

TEST_CASE("a session that could not be made leaves nothing") {
  const TestFolder folder;
  CHECK_THROWS_WITH(rig::make_session(rig::check_output({folder / "new.rig"}),
                                      [](const std::string& unfinished) {
                                        fill(unfinished);
                                        std::ofstream(unfinished + "-wal") << "log";
                                        throw rig::MeasurementError("no more");
                                      }),
                    "no more");
  CHECK(folder.names().empty());
}

TEST_CASE("a program that is killed leaves no session, only one named unfinished, and the next try works") {
  const TestFolder folder;
  const std::string path = folder / "new.rig";
  const pid_t child = ::fork();
  if (child == 0) {
    rig::make_session(rig::check_output({path}), [](const std::string& unfinished) {
      fill(unfinished);
      ::raise(SIGKILL);
    });
    ::_exit(0);
  }
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);
  REQUIRE(WIFSIGNALED(status));
  CHECK(folder.names() == std::set<std::string>{"new.rig.unfinished-" + std::to_string(child)});
  rig::make_session(rig::check_output({path}), fill);
  CHECK(folder.names().contains("new.rig"));
}

TEST_CASE("a new session replaces nothing, neither what is there nor what appears meanwhile") {
  const TestFolder folder;
  const std::string path = folder / "new.rig";
  bool began = false;
  const auto begin = [&](const std::string&) { began = true; };
  fs::create_directory(folder / "folder");
  fs::create_symlink("nowhere", folder / "link");
  std::ofstream(folder / "text") << "kept";
  fill(folder / "recording");
  for (const char* there : {"folder", "link", "text", "recording"}) {
    CAPTURE(there);
    CHECK_THROWS_AS(rig::make_session(rig::check_output({folder / there}), begin), rig::UsageError);
  }
  CHECK_THROWS_WITH(rig::make_session(rig::check_output({folder / "none/new.rig"}), begin),
                    Contains("there is no folder"));
  CHECK_FALSE(began);
  CHECK(file_text(folder / "text") == "kept");

  std::string kept;
  CHECK_THROWS_WITH(rig::make_session(rig::check_output({path}),
                                      [&](const std::string& unfinished) {
                                        kept = unfinished;
                                        fill(unfinished);
                                        std::ofstream(path) << "another program's";
                                      }),
                    Contains("has appeared there meanwhile") && Contains("is kept as"));
  CHECK(file_text(path) == "another program's");
  CHECK(SessionStore(kept, SessionStore::Mode::read).get("bench").has_value());
}

TEST_CASE("an empty file is nothing to be kept: a new session takes its place") {
  const TestFolder folder;
  std::ofstream(folder / "new.rig").flush();
  rig::make_session(rig::check_output({folder / "new.rig"}), fill);
  CHECK(SessionStore(folder / "new.rig", SessionStore::Mode::read).get("bench").has_value());
}

}  // namespace new_session_test
