// SPDX-License-Identifier: MIT
// The index of an archive: what goes in comes out, on every kind of database; what happened to files is seen.
#include <pwd.h>
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <fstream>
#include <map>
#include <optional>
#include <random>

#include "rig/archive/archive_folder.hpp"
#include "rig/errors.hpp"
#include "rig/session/session_file.hpp"
#include "tests/support/calibrations.hpp"
#include "tests/support/programs.hpp"
#include "tests/support/test_folder.hpp"

namespace archive_test {
namespace {

using What = rig::ArchiveFinding::What;

Calibration with_everything() {
  Calibration c;
  c.item_state = "as found";
  c.values = {{"offset_mm", 1.25, 0.125}, {"scale", -0.001953125, 0.0009765625, ""}};
  c.limits = {
      {"checks",
       {{{"name", "Offset"}, {"of", "range.offset_mm"}, {"min", -5}, {"max", 5}, {"verdict", "pass"}}}}};
  c.explanation = {
      {"verdict", "unknown-physics"},
      {"mechanisms",
       {{{"mechanism", "range-walk"},
         {"probability", 0.75},
         {"parameters", {{"size_mm", {{"value", 3.5}, {"u", 0.25}}}}}}}},
      {"undecided_between", nlohmann::json::array({nlohmann::json::array({"zero-offset", "range-scale"})})},
      {"unknown",
       {{"coordinate", "beam_deg"}, {"observable", "range-mean"}, {"describes", "a wave; and more"}}},
      {"empirical_correction",
       {{{"coordinate", "beam_deg"}, {"at", {-90, 0, 90}}, {"range_mm", {0.5, -0.5, 0.25}}}}}};
  return c;
}

std::map<std::string, What> by_path(const std::vector<rig::ArchiveFinding>& findings) {
  std::map<std::string, What> out;
  for (const auto& f : findings) out[f.path] = f.what;
  return out;
}

/// PostgreSQL of its own in a folder, on a socket there; absent where it is not installed.
class Postgresql {
 public:
  Postgresql() {
    const passwd* user = ::getuid() == 0 ? ::getpwnam("postgres") : ::getpwuid(::getuid());
    const std::string programs = "/usr/lib/postgresql/15/bin/";
    if (!user || !std::filesystem::exists(programs + "initdb")) return;
    uid_ = user->pw_uid;
    REQUIRE(::chown(folder_.path().c_str(), uid_, user->pw_gid) == 0);
    const auto become = [uid = uid_, gid = user->pw_gid] {
      if (::getuid() == 0 && (::setgid(gid) != 0 || ::setuid(uid) != 0)) ::_exit(126);
    };
    Program making({programs + "initdb", "-D", folder_ / "data", "-A", "trust", "-U", "rig", "--no-sync",
                    "--locale=C", "-E", "UTF8"},
                   folder_, become);
    if (making.exit_status() != 0) throw std::runtime_error("initdb: " + making.errors());
    server_ = std::make_unique<Program>(
        std::vector<std::string>{programs + "postgres", "-D", folder_ / "data", "-k", folder_.path(), "-h",
                                 "", "-F", "-c", "log_destination=stderr"},
        folder_, become);
    location = "postgresql://rig@/postgres?host=" + folder_.path();
    // It answers when it is ready or refuses at once: asked until it does.
    for (int tries = 0; tries < 200; ++tries) {
      Program asking({programs + "pg_isready", "-q", "-h", folder_.path(), "-t", "5"}, folder_);
      if (asking.exit_status() == 0) return;
      if (server_->ends_within(std::chrono::milliseconds(50)))
        throw std::runtime_error("postgres: " + server_->errors());
    }
    throw std::runtime_error("PostgreSQL does not answer: " + server_->errors());
  }
  ~Postgresql() {
    if (server_) {
      server_->signal(SIGQUIT);
      (void)server_->ends_within(std::chrono::seconds(10));
    }
  }
  std::string location;

 private:
  TestFolder folder_;
  uid_t uid_ = 0;
  std::unique_ptr<Program> server_;
};

void same_record(const rig::SessionRecord& a, const rig::SessionRecord& b) {
  for (const auto member :
       {&rig::SessionRecord::path, &rig::SessionRecord::file_sha256, &rig::SessionRecord::content_sha256,
        &rig::SessionRecord::measured_utc, &rig::SessionRecord::software, &rig::SessionRecord::kind,
        &rig::SessionRecord::procedure, &rig::SessionRecord::procedure_sha256, &rig::SessionRecord::bench,
        &rig::SessionRecord::bench_sha256, &rig::SessionRecord::model, &rig::SessionRecord::serial,
        &rig::SessionRecord::firmware, &rig::SessionRecord::ended, &rig::SessionRecord::item_state})
    CHECK(a.*member == b.*member);
  CHECK(a.bytes == b.bytes);
  CHECK(a.captures == b.captures);
  CHECK(a.scans == b.scans);
  REQUIRE(a.values.size() == b.values.size());
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    CHECK(a.values[i].quantity() == b.values[i].quantity());
    CHECK(a.values[i].value == b.values[i].value);
    CHECK(a.values[i].u == b.values[i].u);
    CHECK(a.values[i].expanded == b.values[i].expanded);
  }
  REQUIRE(a.limits.size() == b.limits.size());
  CHECK(a.limits.front().min == b.limits.front().min);
  REQUIRE(a.explanation.has_value());
  REQUIRE(b.explanation.has_value());
  CHECK(a.explanation->verdict == b.explanation->verdict);
  CHECK(a.explanation->undecided == b.explanation->undecided);
  CHECK(a.explanation->unknown_describes == b.explanation->unknown_describes);
  CHECK(a.explanation->curve == b.explanation->curve);
  REQUIRE(b.explanation->mechanisms.size() == 1);
  CHECK(a.explanation->mechanisms.front().parameters == b.explanation->mechanisms.front().parameters);
}

}  // namespace

TEST_CASE("archive: an index that cannot be made is not said to be damaged, and one that is damaged is") {
  const TestFolder folder;
  CHECK_THROWS_WITH(
      rig::ArchiveIndex(folder / "missing" + "/index.sqlite", true),
      Catch::Contains("Check that its folder exists, and that you may write") && !Catch::Contains("damaged"));
  std::ofstream(folder / "index.sqlite") << std::string(4096, 'x');
  CHECK_THROWS_WITH(rig::ArchiveIndex(folder / "index.sqlite", true),
                    Catch::Contains("It is damaged or no index: move it away"));
}

TEST_CASE("archive: an index gives back what the session says, whatever database holds it") {
  const TestFolder folder;
  with_everything().write(folder / "2026/a.rig");
  const rig::SessionRecord truth = rig::read_session_record(folder.path(), "2026/a.rig");
  REQUIRE(truth.values.size() == 2);
  CHECK(truth.serial == "H0001");
  CHECK(truth.item_state == "as found");
  CHECK(truth.limits.front().max == 5.0);
  CHECK(truth.explanation->undecided == std::vector<std::string>{"zero-offset or range-scale"});
  std::optional<Postgresql> server;
  std::string location = folder / "index.sqlite";
  SECTION("a file") {}
  SECTION("PostgreSQL") {
    server.emplace();
    if (server->location.empty()) {
      WARN("PostgreSQL is not installed: left out");
      return;
    }
    location = server->location;
  }
  {
    rig::ArchiveIndex index(location, true);
    CHECK(by_path(rig::add_to_archive(folder.path(), index)) ==
          std::map<std::string, What>{{"2026/a.rig", What::added}});
    CHECK(rig::add_to_archive(folder.path(), index).empty());
  }
  rig::ArchiveIndex index(location, false);
  const auto sessions = index.sessions();
  REQUIRE(sessions.size() == 1);
  same_record(truth, sessions.front());
  CHECK_THROWS_AS(index.forget_all(), rig::MeasurementError);  // It was opened to read.
  {
    rig::ArchiveIndex again(location, true);
    CHECK(by_path(rig::add_to_archive(folder.path(), again, {.rebuild = true})).at("2026/a.rig") ==
          What::added);
    same_record(truth, again.sessions().at(0));
    std::filesystem::remove(folder / "2026/a.rig");
    CHECK(by_path(rig::add_to_archive(folder.path(), again)).at("2026/a.rig") == What::missing);
    CHECK(again.sessions().size() == 1);
    (void)rig::add_to_archive(folder.path(), again, {.forget_missing = true});
    CHECK(again.sessions().empty());
    CHECK(again.database().run("SELECT 1 FROM result_value").empty());
  }
}

TEST_CASE("archive: damaged, changed, missing, moved and copied files are seen, by add and by verify") {
  const TestFolder folder;
  for (const char* name : {"a", "b", "c", "d", "e", "f"}) {
    Calibration c = with_everything();
    c.serial = std::string("H000") + name;
    c.write(folder / (std::string(name) + ".rig"));
  }
  rig::ArchiveIndex index(folder / "index.sqlite", true);
  CHECK(rig::add_to_archive(folder.path(), index).size() == 6);
  for (const auto& f : rig::verify_archive(folder.path(), index)) CHECK(f.what == What::good);

  {  // A result is added: the measurement stays what it is.
    rig::SessionStore store(folder / "a.rig", rig::SessionStore::Mode::append);
    store.add_result("noise", R"({"values":[{"name":"sigma_mm","value":8,"u":0.1}]})");
  }
  {  // Somebody changes what was measured.
    SQLite::Database database(folder / "b.rig", SQLite::OPEN_READWRITE);
    database.exec("UPDATE scan SET host_us = host_us + 1");
  }
  {  // A byte of the file falls over.
    std::string bytes = file_text(folder / "c.rig");
    for (std::size_t i = 32768; i < bytes.size(); i += 97) bytes[i] = static_cast<char>(bytes[i] ^ 0x55);
    folder.write("c.rig", bytes);
  }
  std::filesystem::remove(folder / "d.rig");
  std::filesystem::rename(folder / "e.rig", folder / "e2.rig");
  std::filesystem::copy(folder / "f.rig", folder / "f2.rig");
  folder.write("g.rig", "no session");

  const auto verified = by_path(rig::verify_archive(folder.path(), index));
  CHECK(verified == std::map<std::string, What>{{"a.rig", What::updated},
                                                {"b.rig", What::changed},
                                                {"c.rig", What::damaged},
                                                {"d.rig", What::missing},
                                                {"e.rig", What::missing},
                                                {"e2.rig", What::copied},
                                                {"f.rig", What::good},
                                                {"f2.rig", What::copied},
                                                {"g.rig", What::damaged}});
  const auto added = by_path(rig::add_to_archive(folder.path(), index));
  CHECK(added == std::map<std::string, What>{{"a.rig", What::updated},
                                             {"b.rig", What::changed},
                                             {"c.rig", What::damaged},
                                             {"d.rig", What::missing},
                                             {"e2.rig", What::moved},
                                             {"f2.rig", What::copied},
                                             {"g.rig", What::damaged}});
  CHECK(index.sessions().size() == 6);  // Nothing is lost from the index by what happened to the files.
  CHECK(by_path(rig::add_to_archive(folder.path(), index, {.accept_changes = true})).at("b.rig") ==
        What::changed);
  CHECK(by_path(rig::verify_archive(folder.path(), index)).at("b.rig") == What::good);
}

TEST_CASE(
    "archive: a session that is being written waits, and no session is changed by being taken in or looked "
    "at") {
  const TestFolder folder;
  with_everything().write(folder / "done.rig");
  const std::string before = file_text(folder / "done.rig");
  rig::SessionStore running(folder / "running.rig", rig::SessionStore::Mode::create);
  running.set("bench", R"({"schema":"bench/1"})");
  CHECK(rig::is_being_written(folder / "running.rig"));
  CHECK_FALSE(rig::is_being_written(folder / "done.rig"));
  std::filesystem::permissions(folder / "done.rig", std::filesystem::perms::owner_read);
  rig::ArchiveIndex index(folder / "index.sqlite", true);
  const auto findings = rig::add_to_archive(folder.path(), index);
  CHECK(by_path(findings) ==
        std::map<std::string, What>{{"done.rig", What::added}, {"running.rig", What::unfinished}});
  CHECK(findings.back().says == "it is being written");
  CHECK(file_text(folder / "done.rig") == before);
  const std::string index_before = file_text(folder / "index.sqlite");
  const auto names = folder.names();
  {
    rig::ArchiveIndex looked_at(folder / "index.sqlite", false);
    (void)looked_at.sessions();
    (void)rig::verify_archive(folder.path(), looked_at);
  }
  CHECK(folder.names() == names);
  CHECK(file_text(folder / "index.sqlite") == index_before);
  CHECK(file_text(folder / "done.rig") == before);
}

TEST_CASE("archive: an explanation beside a session counts if it is newer than the session's own") {
  const TestFolder folder;
  with_everything().write(folder / "a.rig");
  rig::ArchiveIndex index(folder / "index.sqlite", true);
  (void)rig::add_to_archive(folder.path(), index);
  const std::string content = index.sessions().at(0).content_sha256;
  std::filesystem::create_directories(folder / "results/explain");
  std::ofstream(rig::explanation_beside(folder.path(), content))
      << R"({"verdict": "explained", "mechanisms": []})";
  CHECK(by_path(rig::add_to_archive(folder.path(), index)).at("a.rig") == What::updated);
  CHECK(index.sessions().at(0).explanation->verdict == "explained");
  CHECK(rig::add_to_archive(folder.path(), index).empty());
  CHECK(rig::verify_archive(folder.path(), index).at(0).what == What::good);
}

TEST_CASE("archive: an index that is none, or a stranger's, is refused or read without harm") {
  const TestFolder folder;
  with_everything().write(folder / "a.rig");
  CHECK_THROWS_AS(rig::ArchiveIndex(folder / "a.rig", false), rig::UsageError);
  folder.write("text.sqlite", "no database");
  CHECK_THROWS_AS(rig::ArchiveIndex(folder / "text.sqlite", false), rig::UsageError);
  CHECK_THROWS_AS(rig::ArchiveIndex(folder / "nowhere.sqlite", false), rig::UsageError);
  CHECK_FALSE(std::filesystem::exists(folder / "nowhere.sqlite"));
  CHECK_THROWS_AS(rig::ArchiveIndex("postgresql://nobody@/x?host=" + folder.path(), false), rig::UsageError);
  {
    rig::ArchiveIndex index(folder / "index.sqlite", true);
    (void)rig::add_to_archive(folder.path(), index);
  }
  {
    SQLite::Database database(folder / "index.sqlite", SQLite::OPEN_READWRITE);
    database.exec("UPDATE session SET lidar_serial = 'H' || char(27) || '[31m'");
  }
  CHECK(rig::ArchiveIndex(folder / "index.sqlite", false).sessions().at(0).serial == "H?[31m");
  {
    SQLite::Database database(folder / "index.sqlite", SQLite::OPEN_READWRITE);
    database.exec("DROP TABLE mechanism");
    database.exec(
        "CREATE VIEW mechanism AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
        " SELECT '' AS session, i AS at, '' AS mechanism, 1 AS probability FROM n");
  }
  CHECK_THROWS_AS(rig::ArchiveIndex(folder / "index.sqlite", false), rig::UsageError);
}

TEST_CASE(
    "archive: whatever a stranger's session holds ends in a record that any database takes, or in an error") {
  const TestFolder folder;
  rig::ArchiveIndex index(folder / "index.sqlite", true);
  SECTION("a view that never ends in place of a table") {
    with_everything().write(folder / "a.rig");
    SQLite::Database database(folder / "a.rig", SQLite::OPEN_READWRITE);
    database.exec("DROP TABLE result");
    database.exec(
        "CREATE VIEW result AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
        " SELECT 'k' || i AS kind, '' AS created_utc, '{}' AS json FROM n");
  }
  SECTION("documents nested a million deep") {
    with_everything().write(folder / "a.rig");
    rig::SessionStore store(folder / "a.rig", rig::SessionStore::Mode::append);
    const std::string deep = std::string(1'000'000, '[');
    for (const char* kind : {"range", "limits", "explanation"})
      store.add_result(kind, R"({"values": )" + deep);
    store.set("lidar", deep);
    store.set("stage", R"({"model": )" + deep + std::string(1'000'000, ']') + "}");
    store.set("bench", deep);
  }
  SECTION("texts that are no texts, numbers that are none") {
    Calibration c = with_everything();
    c.write(folder / "a.rig");
    rig::SessionStore store(folder / "a.rig", rig::SessionStore::Mode::append);
    store.set("procedure_name", "\xff\xfe\x1b[31m red" + std::string(100'000, 'x'));
    store.set("ended", std::string("a\0b", 3));
    store.add_result(
        "range",
        R"({"values": [{"name": 7, "value": 1e999}, {"name": "a", "value": 3, "u": "x", "k": 0}, 5, null]})");
  }
  SECTION("a file cut off, at any place") {
    with_everything().write(folder / "whole.rig");
    const std::string bytes = file_text(folder / "whole.rig");
    for (std::size_t length = 1; length < bytes.size(); length += bytes.size() / 23)
      folder.write("cut-" + std::to_string(length) + ".rig", bytes.substr(0, length));
  }
  SECTION("bytes fallen over at random") {
    with_everything().write(folder / "whole.rig");
    const std::string bytes = file_text(folder / "whole.rig");
    std::mt19937 random(7);
    for (int i = 0; i < 40; ++i) {
      std::string damaged = bytes;
      for (int n = 1 << (i % 10); n > 0; --n)
        damaged[random() % damaged.size()] = static_cast<char>(random());
      folder.write("damaged-" + std::to_string(i) + ".rig", damaged);
    }
  }
  const auto findings = rig::add_to_archive(folder.path(), index);
  CHECK_FALSE(findings.empty());
  for (const auto& record : index.sessions())
    for (const std::string& text : {record.procedure, record.ended, record.serial, record.path})
      CHECK(rig::is_clean(text));
  for (const auto& f : findings) CHECK((f.what == What::added || !f.says.empty()));
}

}  // namespace archive_test
