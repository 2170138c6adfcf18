// SPDX-License-Identifier: MIT
#include "rig/report/child_program.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "rig/errors.hpp"
#include "rig/report/plot.hpp"
#include "rig/report/report.hpp"
#include "rig/session/session_store.hpp"
#include "tests/support/programs.hpp"

namespace child_program_test {
namespace {

using Catch::Matchers::Contains;
using std::chrono::milliseconds;
using End = rig::ChildResult::End;

constexpr milliseconds soon(100);
constexpr std::chrono::seconds never(60);

rig::ChildResult shell(const std::string& script, milliseconds longest = never) {
  return rig::run_child({"/bin/sh", "-c", script}, longest);
}

/// A program of that name that hangs, before all others along PATH.
class HangingProgram {
 public:
  HangingProgram(const TestFolder& folder, const std::string& name) : before_(std::getenv("PATH")) {
    std::ofstream(folder / name) << "#!/bin/sh\nexec tail -f /dev/null\n";
    std::filesystem::permissions(folder / name, std::filesystem::perms::owner_all);
    ::setenv("PATH", (folder.path() + ":" + before_).c_str(), 1);
  }
  ~HangingProgram() { ::setenv("PATH", before_.c_str(), 1); }
  HangingProgram(const HangingProgram&) = delete;
  HangingProgram& operator=(const HangingProgram&) = delete;

 private:
  std::string before_;
};

}  // namespace

TEST_CASE("a child's documents carry no date, and nothing of ours changes for that") {
  CHECK(shell("echo $SOURCE_DATE_EPOCH").output == "0\n");
  CHECK(std::getenv("SOURCE_DATE_EPOCH") == nullptr);
}

TEST_CASE("a child's output comes whole, and how it ended is reported") {
  const auto much = shell("yes 1234567 | head -n 40000");
  CHECK(much.end == End::done);
  CHECK(much.output.size() == 320'000);
  CHECK(shell("echo said; exit 3").end == End::failed);
  CHECK(shell("kill -TERM $$").end == End::failed);
  CHECK(shell("echo to nobody >&2").output.empty());
  CHECK(shell("cat; echo end of input").output == "end of input\n");
  CHECK(rig::run_child({"rig-no-such-program"}, never).end == End::missing);
}

TEST_CASE("a child that closes its output is waited for all the same") {
  CHECK(shell("echo said; exec >/dev/null; exec tail -f /dev/null", soon).end == End::hung);
}

TEST_CASE("a child that hangs is killed with all that it started") {
  const TestFolder folder;
  const std::string pipe = folder / "held";
  REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
  const int reader = ::open(pipe.c_str(), O_RDONLY | O_NONBLOCK);
  REQUIRE(reader >= 0);
  const auto result =
      shell("exec 9>" + pipe + "; echo begun >&9; echo said; tail -f /dev/null & wait", milliseconds(500));
  CHECK(result.end == End::hung);
  CHECK(result.output == "said\n");
  // The pipe ends when nobody holds it any more, the grandchild neither.
  char begun[6];
  REQUIRE(::read(reader, begun, sizeof begun) == 6);
  pollfd ended{reader, POLLIN, 0};
  CHECK(::poll(&ended, 1, 10'000) == 1);
  CHECK(::read(reader, begun, sizeof begun) == 0);
  ::close(reader);
}

TEST_CASE("a gnuplot that hangs costs its picture, which says so") {
  const TestFolder folder;
  const HangingProgram gnuplot(folder, "gnuplot");
  const rig::Plot plot{"Edge", "x", "y", {{"a", rig::Series::Style::line, {0, 1}, {0, 1}, {}}}};
  CHECK_THAT(rig::to_svg(plot, soon), Contains("gnuplot did not finish within 0.1 s and was stopped"));
}

TEST_CASE("a WeasyPrint that hangs is stopped and named, and leaves nothing") {
  const TestFolder folder;
  {
    rig::SessionStore store(folder / "run.rig", rig::SessionStore::Mode::create);
    store.set("bench", R"({"schema": "bench/1"})");
  }
  const HangingProgram weasyprint(folder, "weasyprint");
  CHECK_THROWS_WITH(
      rig::write_report(folder / "run.rig", rig::check_output({folder / "run.pdf"}), soon),
      Contains("WeasyPrint did not finish within 0.1 s and was stopped") && Contains("write .html"));
  CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 2);
}

}  // namespace child_program_test
