// SPDX-License-Identifier: MIT
#include "rig/whole_file.hpp"

#include <sys/syscall.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "rig/errors.hpp"
#include "tests/support/test_folder.hpp"

namespace whole_file_test {

namespace fs = std::filesystem;

/// What was flushed to the disk while it is watched, by the names that it had then.
struct Flushed {
  bool watched = false;
  std::vector<std::string> names;
};
Flushed flushed;

}  // namespace whole_file_test

/// In place of the system's: what reached the disk cannot be seen from outside.
extern "C" int fsync(int fd) {
  using whole_file_test::flushed;
  if (flushed.watched) {
    std::error_code ignored;
    flushed.names.push_back(std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(fd), ignored));
  }
  return static_cast<int>(::syscall(SYS_fsync, fd));
}

namespace whole_file_test {

TEST_CASE("a file is on the disk before it takes its place, and then its folder") {
  const TestFolder folder;
  const std::string path = folder / "made.txt";
  flushed = {true, {}};
  rig::write_file_atomically(path, "text");
  flushed.watched = false;
  REQUIRE(flushed.names.size() == 2);
  CHECK(flushed.names[0].starts_with(path + ".part"));
  CHECK(flushed.names[1] == folder.path());
}

TEST_CASE("a file takes its place when it is whole, and the old one stands until then") {
  const TestFolder folder;
  const std::string path = folder / "made.txt";
  rig::write_file_atomically(path, "text\nold");
  rig::write_beside(path, [&](const std::string& part) {
    std::ofstream(part) << "text\nnew";
    CHECK(file_text(path) == "text\nold");
  });
  CHECK(file_text(path) == "text\nnew");
  CHECK(folder.names().size() == 1);
}

TEST_CASE("a file that could not be made leaves nothing behind and harms nothing") {
  const TestFolder folder;
  const std::string path = folder / "made.txt";
  rig::write_file_atomically(path, "text\nold");
  const auto half = [](const std::string& part) {
    std::ofstream(part) << "half";
    throw rig::MeasurementError("no more");
  };
  CHECK_THROWS_WITH(rig::write_beside(path, half), "no more");
  CHECK(file_text(path) == "text\nold");
  CHECK(folder.names().size() == 1);
  CHECK_THROWS_WITH(rig::write_beside(path, [](const std::string&) {}),
                    Catch::Contains("the file that was prepared for it has disappeared"));
  CHECK_THROWS_WITH(rig::write_file_atomically(folder / "none/made.txt", "text"),
                    Catch::Contains("none/made.txt: there is no folder " + folder / "none"));
  CHECK_THROWS_WITH(
      rig::write_beside(path, [](const std::string&) { throw rig::DiskFailure("it cannot grow"); }),
      Catch::Contains("cannot write " + path + ": it cannot grow. Is the disk full?"));
  CHECK_THROWS_AS(rig::write_file_atomically("/dev/full", "text"), rig::MeasurementError);
  fs::create_directory(folder / "taken");
  CHECK_THROWS_AS(rig::write_file_atomically(folder / "taken", "text"), rig::UsageError);
  CHECK(folder.names().size() == 2);
}

TEST_CASE("what is not a regular file is written into, never replaced") {
  const TestFolder folder;
  const std::string way = folder / "to-nowhere";
  fs::create_symlink("/dev/null", way);
  rig::write_file_atomically(way, "lost");
  CHECK(fs::is_symlink(way));
  CHECK(folder.names().size() == 1);
}

TEST_CASE("a file takes the place of the one that a link leads to, and the link stays") {
  const TestFolder folder;
  rig::write_file_atomically(folder / "old.txt", "text\nold");
  fs::create_symlink("old.txt", folder / "latest");
  rig::write_file_atomically(folder / "latest", "text\nnew");
  CHECK(fs::is_symlink(folder / "latest"));
  CHECK(file_text(folder / "old.txt") == "text\nnew");
  CHECK(folder.names().size() == 2);
}

}  // namespace whole_file_test
