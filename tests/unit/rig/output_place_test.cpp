// SPDX-License-Identifier: MIT
#include "rig/output_place.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>

#include "rig/errors.hpp"
#include "rig/export/exporter.hpp"
#include "rig/report/report.hpp"
#include "rig/session/session_store.hpp"
#include "rig/whole_file.hpp"
#include "tests/support/test_folder.hpp"

namespace output_place_test {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;

std::string recording_in(const TestFolder& folder, const std::string& name = "run.rig") {
  rig::SessionStore store(folder / name, rig::SessionStore::Mode::create);
  store.set("bench", R"({"schema": "bench/1"})");
  return folder / name;
}

/// Rights count for nothing to the superuser: somebody else asks.
class Nobody {
 public:
  Nobody() : was_root_(::geteuid() == 0) {
    if (was_root_ && ::seteuid(65534) != 0) throw std::runtime_error("cannot become nobody");
  }
  ~Nobody() {
    if (was_root_ && ::seteuid(0) != 0) std::abort();
  }

 private:
  bool was_root_;
};

}  // namespace

TEST_CASE("a recording is known by its mark, whatever it is called and however it is reached") {
  const TestFolder folder;
  const std::string recording = recording_in(folder, "plain.html");
  CHECK(rig::is_recording(recording));
  fs::create_symlink(recording, folder / "link");
  fs::create_hard_link(recording, folder / "second");
  CHECK(rig::is_recording(folder / "link"));
  CHECK(rig::is_recording(folder / "second"));
  CHECK(rig::is_recording(recording + "-wal"));  // What SQLite would put there belongs to it.
  CHECK_FALSE(rig::is_recording(folder / "none"));
  std::ofstream(folder / "page.rig") << "<!doctype html>" << std::string(200, ' ');
  CHECK_FALSE(rig::is_recording(folder / "page.rig"));
  REQUIRE(::mkfifo((folder / "pipe").c_str(), 0600) == 0);
  CHECK_FALSE(rig::is_recording(folder / "pipe"));  // Without waiting for a writer.
}

TEST_CASE("no output replaces a recording, not by a link either") {
  const TestFolder folder;
  const std::string recording = recording_in(folder);
  fs::create_symlink("run.rig", folder / "link.html");
  fs::create_hard_link(recording, folder / "hard.json");
  const std::string before = file_text(recording);
  for (const std::string& path : {recording, folder / "link.html", folder / "hard.json"}) {
    CAPTURE(path);
    CHECK_THROWS_WITH(rig::check_outputs({{path}}),
                      Contains(path) && Contains("recording") && Contains("Give the output another name"));
    CHECK_THROWS_AS(rig::write_file_atomically(path, "text"), rig::UsageError);
    CHECK_THROWS_AS(rig::write_beside(path, [](const std::string& part) { std::ofstream(part) << "x"; }),
                    rig::UsageError);
  }
  CHECK(file_text(recording) == before);
  CHECK(fs::is_symlink(folder / "link.html"));
  CHECK(folder.names().size() == 3);
}

TEST_CASE("reports and exports refuse a recording that has appeared at their place meanwhile") {
  const TestFolder folder;
  const std::string recording = recording_in(folder);
  const rig::OutputPlace place = rig::check_output({folder / "page.html"}, {recording});
  recording_in(folder, "page.html");
  CHECK_THROWS_WITH(rig::write_report(recording, place), Contains("recording"));
  const rig::SessionStore session(recording, rig::SessionStore::Mode::read);
  CHECK_THROWS_WITH(rig::run_export("csv", {recording, &session}, place), Contains("recording"));
}

TEST_CASE("no output replaces what is read, by whatever name") {
  const TestFolder folder;
  std::ofstream(folder / "correction.json") << "{}";
  fs::create_hard_link(folder / "correction.json", folder / "same.json");
  for (const char* name : {"correction.json", "same.json", "./correction.json"})
    CHECK_THROWS_WITH(rig::check_output({folder / name}, {folder / "correction.json"}),
                      Contains("what this command reads"));
  CHECK(file_text(folder / "correction.json") == "{}");
}

TEST_CASE("a session that cannot be made says why, though nobody asked before") {
  const TestFolder folder;
  REQUIRE(::mkfifo((folder / "pipe").c_str(), 0600) == 0);
  const auto refused = [&](const std::string& path, const std::string& why) {
    CHECK_THROWS_WITH(rig::SessionStore(path, rig::SessionStore::Mode::create),
                      Contains("cannot write " + path) && Contains(why));
  };
  refused(folder / "none/run.rig", "Make it first");
  refused(folder / "pipe", "Give the name of a file");
  refused(folder.path(), "Give the name of a file");
  CHECK(folder.names() == std::set<std::string>{"pipe"});
}

TEST_CASE("where an output cannot be written is said before anything is computed, with a remedy") {
  const TestFolder folder;
  std::ofstream(folder / "file.txt") << "text";
  fs::create_directory(folder / "taken");
  const auto refused = [&](const std::string& path, const std::string& why, const std::string& remedy) {
    CAPTURE(path);
    CHECK_THROWS_WITH(rig::check_outputs({{path, "page.html"}}),
                      Contains("cannot write " + path) && Contains(why) && Contains(remedy));
  };
  refused(folder / "none/x.html", "there is no folder " + folder / "none", "Make it first");
  refused(folder / "file.txt/x.html", "is not a folder", "Choose another place");
  refused(folder / "taken", "it is a folder", "such as " + folder / "taken/page.html");
  refused(folder / "taken/", "it is a folder", "such as " + folder / "taken/page.html");
  refused(folder / std::string(300, 'x'), "the name is too long", "shorter");
  refused("/proc/x.html", "cannot make a file in /proc", "another folder");
  REQUIRE(::chmod(folder.path().c_str(), 0755) == 0);
  REQUIRE(::chmod((folder / "file.txt").c_str(), 0444) == 0);
  {
    const Nobody other;
    refused(folder / "x.html", "not permitted", "correct the permissions of " + folder.path());
    refused(folder / "file.txt", "write-protected", "another name");
  }
  CHECK(folder.names().size() == 2);
}

TEST_CASE("what can be written is not touched by asking") {
  const TestFolder folder;
  std::ofstream(folder / "old.html") << "old";
  REQUIRE_NOTHROW(rig::check_outputs({{folder / "old.html"}, {folder / "new.html"}, {""}, {"-", "a", true}},
                                     {folder / "missing.rig", ""}));
  REQUIRE_NOTHROW(rig::check_outputs({{"/dev/null"}, {"/dev/null"}}));
  CHECK(file_text(folder / "old.html") == "old");
  CHECK(folder.names().size() == 1);
}

TEST_CASE("standard output is no file called '-', and takes only what can go there") {
  CHECK_THROWS_WITH(rig::check_output({"-", "session.rig"}),
                    Contains("'-' is standard output") && Contains("session.rig"));
}

TEST_CASE("two outputs are not one file") {
  const TestFolder folder;
  CHECK_THROWS_WITH(rig::check_outputs({{folder / "a"}, {folder / "a"}}), Contains("Give each its own name"));
  fs::create_symlink("a", folder / "b");
  std::ofstream(folder / "a") << "x";
  CHECK_THROWS_WITH(rig::check_outputs({{folder / "a"}, {folder / "b"}}), Contains("Give each its own name"));
}

TEST_CASE("an output replaces its like only: what a person wrote or what was issued stays") {
  const TestFolder folder;
  const std::vector<std::pair<std::string, std::string>> kinds = {
      {"certificate", "{\"explanation\": {\"schema\": \"explanation/1\"}, \"schema\": \"certificate/1\"}"},
      {"bench", "// mine\n{\"schema\": \"bench/1\"}"},
      {"explanation", "<!doctype html>\n<meta name=\"generator\" content=\"rig explanation\"><title>"},
      {"procedure: rotation-cent", "procedure: rotation-centre\nsteps: [home]\n"},
      {"<dcc:digitalCalibration>", "<?xml version=\"1.0\"?>\n<dcc:digitalCalibration>\n"},
      {"%PDF-1.7", "%PDF-1.7\n"},
      {"", ""}};
  for (const auto& [kind, text] : kinds) {
    CAPTURE(kind);
    const std::string file = folder / "file";
    fs::remove(file);
    std::ofstream(file) << text;
    CHECK(rig::kind_of_file(file) == kind);
    for (const auto& [other, its_text] : kinds) {
      CAPTURE(other);
      if (other == kind || kind.empty()) {
        CHECK_NOTHROW(rig::check_output({file, "result", false, other}));
      } else if (!other.empty()) {
        CHECK_THROWS_WITH(rig::check_output({file, "result", false, other}),
                          Contains("of another kind") && Contains("remove that file first"));
        CHECK_THROWS_AS(rig::write_file_atomically(file, its_text), rig::UsageError);
      }
    }
    CHECK(file_text(file) == text);
    CHECK_NOTHROW(rig::write_file_atomically(file, text));
  }
  CHECK(folder.names().size() == 1);
}

}  // namespace output_place_test
