// SPDX-License-Identifier: MIT
#include "rig/runner/turn_track.hpp"
#include "tests/support/runner_rig.hpp"

namespace runner_stage_test {

using Catch::Matchers::Contains;
using namespace runner_rig;

TEST_CASE("every stop of a sweep is reached from the same side") {
  Rig rig("  - home\n  - sweep: {start_deg: 1, stop_deg: 0, step_deg: 0.25, samples: 2}\n");
  rig.run();
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 5);
  for (const auto& capture : captures) CHECK(capture.approach == 1);
  CHECK(captures[4].stage_deg == 0);
}

TEST_CASE("a turning stage is stopped at its soft limit even if the lidar says nothing") {
  Rig rig("  - home\n  - turn: {rate_deg_s: 20, from_deg: 100, samples: 40}\n");
  rig.prepare = [&](rig::Runner& runner) {
    runner.observe(
        [&](const rig::RunState& state) { rig.lidar.silent = state.activity.starts_with("turning"); });
  };
  CHECK_THROWS_WITH(rig.run(), Contains("soft limit"));
  CHECK_FALSE(rig.stage.moving);
}

TEST_CASE("a turning stage is stopped at its soft limit while scans keep coming") {
  Rig rig("  - home\n  - turn: {rate_deg_s: 20, from_deg: 100, samples: 60}\n");
  rig.stage.yields_at_stop = 50;  // At 9600 baud a stop takes longer than a scan.
  rig.lidar.before_scan = [&](std::uint64_t) {
    if (rig.stage.moving) rig.world.clock.now_us += 75'000;  // Scans come at a quarter of the rate.
  };
  CHECK_THROWS_WITH(rig.run(), Contains("soft limit"));
  CHECK_FALSE(rig.stage.moving);
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK_THAT(captures[0].step, Contains("(short)"));
  CHECK(captures[0].stamps.size() < 36);  // 70 deg at 20 deg/s, ten scans a second
}

TEST_CASE("a stage without soft limits turns for as long as the scans take") {
  Rig rig("  - home\n  - turn: {rate_deg_s: 0.08, from_deg: 0, samples: 40}\n");
  rig.bench.document = R"({"stage": {"speed_deg_s": 20}})";
  rig.world.clock.is_real = false;
  double longest_s = 0;
  rig.world.clock.when_asleep = [&](double seconds) { longest_s = std::max(longest_s, seconds); };
  CHECK(rig.run());
  CHECK(longest_s < 1e6);
  REQUIRE(rig.captures().size() == 1);
  CHECK(rig.captures()[0].stamps.size() == 40);
}

TEST_CASE("a clock sleeps for as long as is asked, however long that is") {
  boost::asio::io_context io{1};
  const auto clock = rig::make_real_clock();
  bool woken = false;
  for (const double seconds : {1e10, 1.8e10, 1e300})
    boost::asio::co_spawn(io, clock->sleep(seconds), [&](std::exception_ptr) { woken = true; });
  for (int i = 0; i < 100; ++i) io.poll();
  CHECK_FALSE(woken);
}

TEST_CASE("a rate of turning that turns out to be 0 is refused where it is written") {
  Rig rig(
      "  - home\n  - prompt: {title: x, ask: {name: rate, default: 0}}\n"
      "  - turn: {rate_deg_s: '${rate}', from_deg: 0, samples: 5}\n");
  CHECK_THROWS_WITH(rig.run(), Contains("a rate of 0 is a 'capture'") && Contains("test.yaml:5"));
  CHECK_FALSE(rig.stage.moving);
}

TEST_CASE(
    "a procedure with turns is refused before anything is measured where the clocks have nothing in common") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - turn: {rate_deg_s: 4, from_deg: 0, samples: 60}\n");
  rig.lidar.runs_on_its_own_time = true;
  CHECK_THROWS_WITH(rig.run(), Contains("step 3") && Contains("--speed real"));
  CHECK(rig.stage.homings == 0);
  CHECK(rig.stage.moves.empty());
  Rig at_rest("  - home\n  - capture: {samples: 5}\n");
  at_rest.lidar.runs_on_its_own_time = true;
  CHECK(at_rest.run());
}

TEST_CASE("a turn is dated by clocks that were compared just before it, however long the run has lasted") {
  Rig rig("  - home\n  - capture: {samples: 40000}\n  - turn: {rate_deg_s: 4, from_deg: 0, samples: 60}\n");
  rig.lidar.drift_ppm = 50;
  std::int64_t late_us = 0;
  rig.lidar.tamper = [&](lidar::Scan& scan) {
    if (rig.stage.moving) late_us = std::max(late_us, scan.host_us - rig.world.clock.now_us);
  };
  rig.lidar.compared_us = rig.world.clock.now_us;
  CHECK(rig.run());
  CHECK(rig.captures().size() == 2);
  CHECK(late_us < 1000);  // of the 50 ms that the clocks differ by in the 1000 s before
}

TEST_CASE("a turn during which the lidar is lost for a while is begun anew and is whole") {
  Rig rig("  - home\n  - turn: {rate_deg_s: 4, from_deg: 0, samples: 60}\n");
  bool moved_while_lost = false;
  rig.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 72) throw rig::DeviceError("cable pulled.");
  };
  rig.lidar.when_connecting = [&] { moved_while_lost |= rig.stage.moving; };
  CHECK(rig.run());
  CHECK_FALSE(moved_while_lost);
  CHECK_FALSE(rig.stage.moving);
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK_THAT(captures[0].step, !Contains("short"));
  CHECK(captures[0].stamps.size() == 60);
  CHECK(rig.lidar.connects == 2);
  CHECK(rig.reported("repeated from its start"));
}

TEST_CASE("a turn in which the stage stops, or turns at another rate, is begun anew, and never recorded") {
  const std::string steps = "  - home\n  - turn: {rate_deg_s: 15, from_deg: -40, samples: 80}\n";
  Rig stopped(steps);
  stopped.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 72) stopped.stage.moving = false;
  };
  CHECK(stopped.run());
  CHECK(stopped.stage.turns == 2);
  CHECK(stopped.reported("stopped at"));
  REQUIRE(stopped.captures().size() == 1);
  CHECK(stopped.captures()[0].stamps.size() == 80);

  Rig slow(steps);
  slow.stage.turns_at = 8. / 15;
  CHECK_THROWS_WITH(slow.run(), Contains("turned at 8.0 deg/s instead of 15.0 deg/s"));
  CHECK(slow.stage.turns == 3);
  CHECK_FALSE(slow.stage.moving);
  CHECK(slow.captures().empty());

  // One that goes on saying that it moves.
  Rig stuck(steps);
  stuck.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 72) stuck.stage.turns_at = 0, stuck.stage.began_deg = stuck.world.stage_deg;
    if (stuck.stage.turns == 2) stuck.stage.turns_at = 1;
  };
  CHECK(stuck.run());
  CHECK(stuck.reported("off a straight line"));
  REQUIRE(stuck.captures().size() == 1);
  CHECK_THAT(stuck.captures()[0].step, !Contains("short"));
}

TEST_CASE("late answers of a turning stage are no disturbance, and count for little") {
  rig::TurnTrack track;
  for (int i = 0; i < 20; ++i) track.add(0.1 * i, 1.5 * i, 0.005);
  track.add(2.5, 30.5, 0.5);  // Answered a second after it was asked.
  CHECK(track.disturbance(15, 0.01).empty());
  CHECK_THAT(track.line_at(1).at_deg, Catch::Matchers::WithinAbs(15, 0.01));
  track.add(2.1, 30.5, 0.005);
  CHECK_THAT(track.disturbance(15, 0.01), Contains("off a straight line"));
}

TEST_CASE("a lidar that restarts while the stage turns is reported and recorded") {
  Rig rig("  - home\n  - turn: {rate_deg_s: 4, from_deg: 0, samples: 60}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 60) rig.lidar.restarts = 1;
  };
  CHECK(rig.run());
  CHECK(rig.times_reported("its power was cut") == 1);
  const rig::SessionStore session(rig.file, rig::SessionStore::Mode::read);
  CHECK(nlohmann::json::parse(session.get("lidar_restarts").value_or("[]")).size() == 1);
}

TEST_CASE("a turn during which the stage falls silent is begun anew, homed if it has to be") {
  Rig rig("  - home\n  - turn: {rate_deg_s: 4, from_deg: 0, samples: 60}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 60) rig.stage.loses_link_at_status = true;
  };
  CHECK(rig.run());
  CHECK_FALSE(rig.stage.moving);
  CHECK(rig.stage.homings == 2);
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK(captures[0].stamps.size() == 60);
}

TEST_CASE("a stage that fails while it is homed is homed again, three times at most") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.stage.failing_homings = 1;
  CHECK(rig.run());
  CHECK(rig.stage.homed);
  Rig never("  - home\n  - capture: {samples: 5}\n");
  never.stage.failing_homings = 100;
  CHECK_THROWS_WITH(never.run(), Contains("no reference"));
  CHECK(never.captures().empty());
}

TEST_CASE("an interrupted turn keeps its scans, marked short, until a whole one replaces them") {
  Rig rig("  - home\n  - turn: {rate_deg_s: 4, from_deg: 0, samples: 60}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 72; };
  CHECK_THROWS(rig.run());
  CHECK_FALSE(rig.stage.moving);
  auto captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK_THAT(captures[0].step, Contains("(short)"));
  CHECK(captures[0].stamps.size() < 60);
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  CHECK(rig.run());
  captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK(captures[0].stamps.size() == 60);
}

TEST_CASE("an abort stops a turning stage before it waits for a lidar that does not answer") {
  Rig rig("  - home\n  - turn: {rate_deg_s: 4, from_deg: 0, samples: 200}\n");
  bool stood = false;
  rig.prepare = [&](rig::Runner& runner) {
    rig.lidar.when_silent = [&] { runner.abort(); };
    rig.lidar.at_cancel = [&] { stood = !rig.stage.moving; };
    runner.observe(
        [&](const rig::RunState& state) { rig.lidar.silent = state.done >= 20 && rig.stage.moving; });
  };
  CHECK_THROWS_AS(rig.run(), rig::RunStopped);
  CHECK(stood);
}

TEST_CASE("a stage that does not arrive is sent again, then stopped with a reason") {
  Rig rig("  - home\n  - move: {to_deg: 10}\n  - capture: {samples: 5}\n");
  rig.stage.readback_error_deg = 0.1;
  CHECK_THROWS_WITH(rig.run(), Contains("reads back 10.1") && Contains("3 times"));
  CHECK(rig.stage.stops >= 1);
  CHECK(rig.captures().empty());
}

TEST_CASE("a stage that lost its link is opened again, homed again, and reached from the right side") {
  Rig rig("  - home\n  - sweep: {start_deg: 0, stop_deg: 1, step_deg: 0.25, samples: 3}\n");
  rig.stage.loses_link_at_move = 3;
  rig.run();
  CHECK(rig.stage.reopens == 1);
  CHECK(rig.stage.homings == 2);
  REQUIRE(rig.captures().size() == 5);
  for (const auto& capture : rig.captures()) CHECK(capture.approach == 1);
}

TEST_CASE("a stage whose port is gone is waited for as long as a lidar, and no longer") {
  Rig rig("  - home\n  - move: {to_deg: 10}\n  - capture: {samples: 5}\n");
  rig.stage.loses_link_at_move = 0;
  std::int64_t lost_us = 0;
  rig.stage.is_plugged_in = [&] {
    if (lost_us == 0) lost_us = rig.world.clock.now_us;
    return rig.world.clock.now_us >= lost_us + 20'000'000;
  };
  CHECK(rig.run());
  CHECK(rig.reported("waiting for the stage"));
  CHECK(rig.stage.homings == 2);
  Rig gone("  - home\n  - move: {to_deg: 10}\n  - capture: {samples: 5}\n");
  gone.stage.loses_link_at_move = 0;
  gone.stage.is_plugged_in = [] { return false; };
  const std::int64_t begun_us = gone.world.clock.now_us;
  CHECK_THROWS_WITH(gone.run(), Contains("port is not there") && Contains("waited 30 s"));
  CHECK(gone.world.clock.now_us < begun_us + 40'000'000);
}

TEST_CASE("a stage that is found moving is stopped before anything else") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.stage.moving = true;
  rig.run();
  CHECK(rig.reported("found moving"));
}

}  // namespace runner_stage_test
