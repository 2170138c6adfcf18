// SPDX-License-Identifier: MIT
#include <sys/resource.h>
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "rig/report/pdf.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/programs.hpp"

namespace outputs_test {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

std::string recording_in(const TestFolder& folder, const std::string& name) {
  rig::SessionStore store(folder / name, rig::SessionStore::Mode::create);
  store.set("bench", R"({"schema": "bench/1"})");
  return folder / name;
}

Words rig_command(Words words) {
  words.insert(words.begin(), RIG_BIN_DIR "/rig");
  return words;
}

}  // namespace

TEST_CASE("no command replaces a recording, nor what it reads") {
  const TestFolder folder;
  const std::string input = recording_in(folder, "in.rig"), kept = recording_in(folder, "kept.rig"),
                    bench = folder / "a.bench.json";
  std::ofstream(bench) << R"({"schema": "bench/1"})";
  fs::create_symlink(kept, folder / "link");
  const std::string before = file_text(kept), bench_before = file_text(bench);
  const Words with_check = {"check",   "--lidar", "tcp://127.0.0.5:1", "--stage", "serial:none",
                            "--bench", bench};
  for (const std::string& output : {kept, folder / "link"})
    for (const Words& words : std::vector<Words>{{"fit", "noise", input, "--json", output},
                                                 {"explain", input, "--json", output},
                                                 {"explain", input, "--report", output},
                                                 {"explain", input, "--next", output},
                                                 {"report", input, "-o", output},
                                                 {"report", input, "--json", output},
                                                 {"compare", input, "--with", input, "-o", output},
                                                 {"compare", input, "--with", input, "--json", output},
                                                 {"export", input, "--format", "csv", "-o", output},
                                                 {"deskew", input, "-o", output},
                                                 {"apply", bench, input, "-o", output},
                                                 {"import", bench, "-o", output},
                                                 {"devices", "--no-probe", "--json", output},
                                                 {"new", "bench", output}}) {
      CAPTURE(words);
      Program program(rig_command(words), folder);
      CHECK(program.exit_status() == 2);
      CHECK_THAT(program.errors(), Catch::Contains("recording"));
      CHECK(file_text(kept) == before);
    }
  Words check = with_check;
  check.insert(check.end(), {"--json", bench});
  Program program(rig_command(check), folder);
  CHECK(program.exit_status() == 2);
  CHECK_THAT(program.errors(), Catch::Contains("what this command reads"));
  CHECK(file_text(bench) == bench_before);
}

TEST_CASE("a page is HTML or PDF, as its name says, and nothing else") {
  const TestFolder folder;
  const std::string input = recording_in(folder, "in.rig"), other = folder / "page.txt";
  for (const Words& words : std::vector<Words>{{"explain", input, "--report", other},
                                               {"compare", input, "--with", input, "-o", other},
                                               {"history", "H1", "--archive", folder / "", "-o", other},
                                               {"fleet", "--archive", folder / "", "-o", other}}) {
    CAPTURE(words);
    Program program(rig_command(words), folder);
    CHECK(program.exit_status() == 2);
    CHECK_THAT(program.errors(), Catch::Contains("page.txt: this is written as .html or .pdf"));
  }
  rig::write_page(folder / "page.html", "<p>Words</p>");
  CHECK(file_text(folder / "page.html") == "<p>Words</p>");
  if (std::system("command -v weasyprint >/dev/null 2>&1") != 0) return;
  rig::write_page(folder / "page.pdf", "<p>Words</p>");
  CHECK_THAT(file_text(folder / "page.pdf"), Catch::Matchers::StartsWith("%PDF"));
}

TEST_CASE("a full disk is told alike by whatever writes a file, and leaves nothing of it") {
  const TestFolder folder;
  const std::string input = folder / "in.rig";
  {
    rig::SessionStore store(input, rig::SessionStore::Mode::create);
    store.set("bench", R"({"schema": "bench/1"})");
    fit::CaptureInfo info;
    info.last_step = 999;
    const auto capture = store.begin_capture(info);
    std::vector<std::uint16_t> ranges(1000);
    std::minstd_rand random;
    for (auto& range : ranges) range = static_cast<std::uint16_t>(random() % 10'000);
    fit::ScanView scan;
    scan.range_mm = ranges;
    for (; scan.seq < 100; ++scan.seq) store.add_scan(capture, scan);
    store.commit_capture(capture);
  }
  for (const std::string format : {"hdf5", "csv", "mcap", "db3"}) {
    CAPTURE(format);
    const std::string output = folder / "out";
    Program program(rig_command({"export", input, "--format", format, "-o", output}), folder, [] {
      const rlimit limit{2000, RLIM_INFINITY};
      ::setrlimit(RLIMIT_FSIZE, &limit);
    });
    CHECK(program.exit_status() == 1);
    CHECK_THAT(program.errors(), Catch::Contains("cannot write " + output) && Catch::Contains("disk"));
    CHECK(!fs::exists(output));
  }
}

TEST_CASE("a session whose run was killed is said to have a log, and to be one file again once it is") {
  const TestFolder folder;
  const std::string session = recording_in(folder, "in.rig");
  const pid_t child = fork();
  if (child == 0) {
    rig::SessionStore store(session, rig::SessionStore::Mode::append);
    store.set("name", "killed");
    raise(SIGKILL);
  }
  REQUIRE(waitpid(child, nullptr, 0) == child);
  REQUIRE(fs::exists(session + "-wal"));
  const Words words = rig_command({"report", session, "-o", folder / "page.html"});
  Program first(words, folder);
  CHECK(first.exit_status() == 0);
  CHECK_THAT(first.errors(), Catch::Contains("has a log beside it") &&
                                 Catch::Contains("note: " + session + " is one file again"));
  CHECK_FALSE(fs::exists(session + "-wal"));
  Program second(words, folder);
  CHECK(second.exit_status() == 0);
  CHECK_THAT(second.errors(), !Catch::Contains("note: "));
}

TEST_CASE("with --json - standard output holds the document alone") {
  const TestFolder folder;
  const std::string input = recording_in(folder, "in.rig");
  Program program(rig_command({"report", input, "-o", folder / "page.html", "--json", "-"}), folder);
  std::string output;
  while (const auto line = program.line()) output += *line + "\n";
  CHECK(program.exit_status() == 0);
  CHECK(nlohmann::json::parse(output).at("schema") == "certificate/1");
  CHECK_THAT(program.errors(), Catch::Contains("page.html"));
  CHECK(fs::exists(folder / "page.html"));
}

TEST_CASE("an export goes to standard output, where nothing else is said, and makes no file called '-'") {
  const TestFolder folder;
  const std::string input = recording_in(folder, "in.rig");
  Program program(rig_command({"export", input, "--format", "json", "-o", "-"}), folder);
  std::string output;
  while (const auto line = program.line()) output += *line + "\n";
  CHECK(program.exit_status() == 0);
  CHECK(nlohmann::json::parse(output).contains("captures"));
  CHECK(program.errors().empty());
  CHECK(!fs::exists(folder / "-"));
}

TEST_CASE("a check that a device ends still gives its document, with the error") {
  const TestFolder folder;
  const std::string bench = folder / "a.bench.json";
  std::ofstream(bench) << R"({"schema": "bench/1"})";
  Program program(rig_command({"check", "--lidar", "tcp://127.0.0.6:1", "--stage",
                               "serial:" + (folder / "none"), "--bench", bench, "--json", "-"}),
                  folder);
  std::string output;
  while (const auto line = program.line()) output += *line + "\n";
  CHECK(program.exit_status() == 3);
  const auto document = nlohmann::json::parse(output);
  CHECK(document.at("lines").empty());
  CHECK_THAT(document.at("error").get<std::string>(), Catch::Contains("is not there"));
}

TEST_CASE(
    "a session given for a bench, a bench for a session, and a session twice, are called what they are") {
  const TestFolder folder;
  const std::string session = recording_in(folder, "in.rig"), bench = folder / "a.bench.json";
  std::ofstream(bench) << R"({"schema": "bench/1"})";
  const std::string copy = folder / "copy.rig";
  std::filesystem::copy_file(session, copy);
  for (const auto& [words, expected] : std::vector<std::pair<Words, std::string>>{
           {{"explain", session, "--bench", session}, "is a session, not a bench file"},
           {{"explain", session, session}, "is given twice: what it holds would count twice"},
           {{"explain", session, "--predict", "./in.rig"}, "are one file"},
           {{"fit", "noise", session, session}, "is given twice"},
           {{"fit", "noise", session, copy}, "holds the same recording as"},
           {{"explain", bench}, "is a text file, not a session file"},
           {{"report", bench}, "is a text file, not a session file"}}) {
    CAPTURE(words);
    Program program(rig_command(words), folder);
    CHECK(program.exit_status() == 2);
    CHECK_THAT(program.errors(), Catch::Contains(expected));
  }
}

TEST_CASE("a mechanism or a parameter by a wrong name in a bench file is refused by whoever reads the file") {
  const TestFolder folder;
  const std::string procedure = folder / "p.yaml", bench = folder / "a.bench.json",
                    session = recording_in(folder, "in.rig");
  std::ofstream(procedure) << "procedure: test\nsteps:\n  - home\n";
  const Words check = {"check", "--lidar", "tcp://127.0.0.5:1", "--stage", "serial:none", "--bench", bench};
  for (const auto& [known, expected] : std::vector<std::pair<std::string, std::string>>{
           {R"({"mechanism": "range-nois", "parameters": {"sigma_mm": 8}})", "did you mean 'range-noise'?"},
           {R"({"mechanism": "range-noise", "parameters": {"sigma_m": 8}})", "it has sigma_mm"},
           {R"({"mechanism": "subsurface", "parameters": {"offset_mm": 2, "target": "bord"}})",
            "the target \"bord\", which the bench does not have"}}) {
    std::ofstream(bench) << R"({"schema": "bench/1", "known": [)" << known << "]}";
    for (const Words& words : std::vector<Words>{{"run", procedure, "--dry-run", "--bench", bench},
                                                 {"explain", session, "--bench", bench},
                                                 check}) {
      CAPTURE(words);
      Program program(rig_command(words), folder);
      CHECK(program.exit_status() == 2);
      CHECK_THAT(program.errors(), Catch::Contains("a.bench.json") && Catch::Contains(expected));
    }
  }
}

TEST_CASE("before a run, a report in the session's place is refused, and what is implausible is listed") {
  const TestFolder folder;
  const std::string procedure = folder / "p.yaml", bench = folder / "a.bench.json";
  std::ofstream(procedure) << "procedure: test\nsteps:\n  - home\n  - report: {file: page.html}\n";
  std::ofstream(bench) << R"({"schema": "bench/1", "targets": [{"name": "board", "from_mm": [1400, -200],
    "to_mm": [1400, 200], "reflectance": 85}], "stage": {"limits_deg": [-2.96, 2.96]}})";
  const auto run = [&](Words more) {
    Words words = {"run", procedure, "--bench", bench};
    words.insert(words.end(), more.begin(), more.end());
    return std::make_unique<Program>(rig_command(words), folder);
  };
  for (const Words& more :
       {Words{"--dry-run"}, Words{"--lidar", "tcp://127.0.0.1:1", "--stage", "serial:none"}}) {
    Words words = more;
    words.insert(words.end(), {"--out", folder / "page.html"});
    const auto program = run(words);
    CHECK(program->exit_status() == 2);
    CHECK_THAT(program->errors(), Catch::Contains("p.yaml:4:") && Catch::Contains("over the session"));
  }
  const auto listing = run({"--dry-run"});
  std::string said;
  while (const auto line = listing->line()) said += *line + "\n";
  CHECK(listing->exit_status() == 0);
  CHECK_THAT(said, Catch::Contains("is it in per cent?") && Catch::Contains("is it in radians?"));
  CHECK(run({"--dry-run", "--yes"})->exit_status() == 2);
}

}  // namespace outputs_test
