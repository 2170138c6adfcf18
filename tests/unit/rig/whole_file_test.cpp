// SPDX-License-Identifier: MIT
#include "rig/whole_file.hpp"

#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "rig/errors.hpp"

namespace {

namespace fs = std::filesystem;

struct Folder {
  Folder() : path(fs::temp_directory_path() / ("rig-whole-file-" + std::to_string(::getpid()))) {
    fs::remove_all(path);
    fs::create_directories(path);
  }
  ~Folder() { fs::remove_all(path); }
  [[nodiscard]] std::string file(const std::string& name) const { return (path / name).string(); }
  [[nodiscard]] auto files() const { return std::distance(fs::directory_iterator(path), {}); }
  fs::path path;
};

std::string contents(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

TEST_CASE("a file takes its place when it is whole, and the old one stands until then") {
  const Folder folder;
  const std::string path = folder.file("made.txt");
  rig::write_file_atomically(path, "old");
  rig::write_beside(path, [&](const std::string& part) {
    std::ofstream(part) << "new";
    CHECK(contents(path) == "old");
  });
  CHECK(contents(path) == "new");
  CHECK(folder.files() == 1);
}

TEST_CASE("a file that could not be made leaves nothing behind and harms nothing") {
  const Folder folder;
  const std::string path = folder.file("made.txt");
  rig::write_file_atomically(path, "old");
  const auto half = [](const std::string& part) {
    std::ofstream(part) << "half";
    throw rig::MeasurementError("no more");
  };
  CHECK_THROWS_WITH(rig::write_beside(path, half), "no more");
  CHECK(contents(path) == "old");
  CHECK(folder.files() == 1);
  CHECK_THROWS_WITH(rig::write_beside(path, [](const std::string&) {}),
                    Catch::Contains("what was made for it is gone"));
  CHECK_THROWS_WITH(rig::write_file_atomically(folder.file("none/made.txt"), "text"),
                    Catch::Contains("none/made.txt: there is no folder " + folder.file("none")));
  fs::create_directory(folder.file("taken"));
  CHECK_THROWS_AS(rig::write_file_atomically(folder.file("taken"), "text"), rig::UsageError);
  CHECK(folder.files() == 2);
}

TEST_CASE("what is no plain file is written into, never replaced") {
  const Folder folder;
  const std::string way = folder.file("to-nowhere");
  fs::create_symlink("/dev/null", way);
  rig::write_file_atomically(way, "lost");
  CHECK(fs::is_symlink(way));
  CHECK(folder.files() == 1);
}

TEST_CASE("a file takes the place of the one that a link leads to, and the link stays") {
  const Folder folder;
  rig::write_file_atomically(folder.file("old.txt"), "old");
  fs::create_symlink("old.txt", folder.file("latest"));
  rig::write_file_atomically(folder.file("latest"), "new");
  CHECK(fs::is_symlink(folder.file("latest")));
  CHECK(contents(folder.file("old.txt")) == "new");
  CHECK(folder.files() == 2);
}
