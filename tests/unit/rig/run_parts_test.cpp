// SPDX-License-Identifier: MIT
// The parts of a run, each by itself: what is recorded, stops and pauses, answers, echoes.
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

#include "rig/runner/answer_desk.hpp"
#include "rig/runner/echoes.hpp"
#include "rig/runner/endpoint.hpp"
#include "rig/runner/gate.hpp"
#include "rig/runner/run_control.hpp"
#include "rig/runner/run_progress.hpp"
#include "tests/support/runner_rig.hpp"
#include "tests/support/test_folder.hpp"

namespace run_parts_test {

namespace asio = boost::asio;
using asio::awaitable;
using Catch::Matchers::Contains;
using nlohmann::json;

namespace {

struct NewSession {
  TestFolder folder;
  rig::SessionStore store{folder / "s.rig", rig::SessionStore::Mode::create};
};

/// Runs until nothing is left to do; false if `work` still waits then.
bool ends(asio::io_context& io, awaitable<void> work) {
  bool done = false;
  asio::co_spawn(io, std::move(work), [&done](const std::exception_ptr& why) {
    if (why) std::rethrow_exception(why);
    done = true;
  });
  io.restart();
  io.poll();
  return done;
}

struct SilentOperator : rig::Operator {
  std::optional<rig::Answer> says;  ///< At once; without it, he fails.
  awaitable<rig::Answer> ask(rig::Prompt) override {
    co_await runner_rig::yield();
    if (!says) throw std::runtime_error("the terminal is gone");
    co_return *says;
  }
  bool unattended() const override { return false; }
};

}  // namespace

TEST_CASE("a gate that is opened after whoever waited is gone, and a waiter that outlives it, harm nothing") {
  rig::Gate gate;
  {
    boost::asio::io_context io;
    boost::asio::co_spawn(io, gate.wait(), boost::asio::detached);
    io.poll();
  }
  gate.open();
  CHECK(gate.is_open());
  boost::asio::io_context io;
  {
    rig::Gate shorter;
    boost::asio::co_spawn(io, shorter.wait(), boost::asio::detached);
    io.poll();
  }
}

TEST_CASE("an address that is none is refused with the form that its option takes") {
  CHECK_THROWS_WITH(rig::parse_endpoint("foo:x", "--lidar", 10940),
                    Contains("--lidar 'foo:x' is not an address; write HOST:PORT"));
  CHECK_THROWS_WITH(
      rig::parse_endpoint("foo", "--operator", 0),
      Contains("--operator 'foo' is not an address; write HOST:PORT, for example 192.168.0.10:10940"));
  CHECK(rig::parse_endpoint("127.0.0.1:4000", "--operator", 0).port == 4000);
}

TEST_CASE("what is recorded of a run is there again, and a step is forgotten with its parts") {
  NewSession session;
  rig::RunProgress progress(session.store);
  CHECK(progress.of("1").is_null());
  progress.record("1", {{"homed", true}});
  progress.record("2/0", {{"capture", 1}});
  progress.record("2/1", {{"capture", 2}});
  progress.record("2/2/short", {{"capture", 3}});
  progress.record("20", {{"homed", true}});
  CHECK(rig::RunProgress(session.store).of("1") == json{{"homed", true}});

  std::vector<rig::PlannedStep> plan(1);
  plan[0].key = "2";
  plan[0].captures = 5;
  CHECK(progress.captures_begun(plan[0]) == 2);  // A short one is measured again.
  plan[0].captures = 1;
  CHECK(progress.captures_begun(plan[0]) == 1);

  progress.forget(plan);
  CHECK_FALSE(progress.has("2/0"));
  CHECK_FALSE(rig::RunProgress(session.store).has("2/2/short"));
  CHECK(rig::RunProgress(session.store).has("20"));
}

TEST_CASE("a withdrawn part is no longer taken as done") {
  NewSession session;
  rig::RunProgress progress(session.store);
  progress.record("1/0", {{"capture", 1}});
  progress.withdraw("1/0");
  CHECK_FALSE(progress.has("1/0"));
}

TEST_CASE("a stop is for good and ends a pause; a pause that was resumed before it took hold holds nothing") {
  NewSession session;
  asio::io_context io;
  rig::RunControl control(session.store);
  CHECK_NOTHROW(control.stop_if_aborted());
  control.pause();
  CHECK(control.paused());
  control.resume();
  CHECK(ends(io, control.until_resumed()));
  control.pause();
  bool resumed = false;
  const auto wait = [&]() -> awaitable<void> {
    co_await control.until_resumed();
    resumed = true;
  };
  CHECK_FALSE(ends(io, wait()));
  control.abort();
  io.restart();
  io.poll();
  CHECK(resumed);
  CHECK(ends(io, control.until_aborted()));
  control.resume();
  CHECK_THROWS_WITH(control.stop_if_aborted(), Contains("Nothing was captured yet"));
}

TEST_CASE("the first answer counts, wherever it comes from") {
  asio::io_context io;
  runner_rig::FakeClock clock;
  SilentOperator person;
  rig::AnswerDesk desk(person, clock);
  rig::Answer skipped, confirmed;
  skipped.kind = rig::Answer::Kind::skipped;

  SECTION("from elsewhere") {
    person.says = confirmed;
    desk.open();
    desk.answer(skipped);
    CHECK(desk.is_over());
    CHECK(ends(io, desk.wait(rig::Prompt(), rig::never())));
    CHECK(desk.taken()->kind == rig::Answer::Kind::skipped);
  }
  SECTION("from the operator") {
    person.says = confirmed;
    desk.open();
    CHECK_FALSE(desk.is_over());
    CHECK(ends(io, desk.wait(rig::Prompt(), rig::never())));
    CHECK(desk.taken()->kind == rig::Answer::Kind::confirmed);
  }
  SECTION("an operator who fails is a failure, once") {
    desk.open();
    CHECK(ends(io, desk.wait(rig::Prompt(), rig::never())));
    CHECK_THROWS_WITH(desk.taken(), "the terminal is gone");
    CHECK_FALSE(desk.taken());
  }
  SECTION("what was answered before is forgotten") {
    desk.answer(skipped);
    desk.open();
    CHECK_FALSE(desk.is_over());
  }
}

TEST_CASE("echoes are judged by their medians, of beams that had one in half of ten scans") {
  rig::Echoes echoes(2);
  lidar::Scan scan;
  for (int i = 0; i < 10; ++i) {
    CHECK_FALSE(echoes.enough());
    // The beams begin at the second of the scan; the last has four echoes.
    scan.range_mm = {9999, static_cast<std::uint16_t>(1000 + i),
                     static_cast<std::uint16_t>(i < 4 ? 2000 : 0)};
    scan.intensity = {1, 500, 700};
    echoes.add(scan, 1);
  }
  CHECK(echoes.enough());
  const rig::BeamMedians seen = echoes.seen();
  CHECK(seen.range_mm[0] == Approx(1004.5).margin(0.5));
  CHECK(seen.intensity[0] == 500);
  CHECK(std::isnan(seen.range_mm[1]));
}

}  // namespace run_parts_test
