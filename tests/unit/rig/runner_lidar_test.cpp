// SPDX-License-Identifier: MIT
#include <algorithm>
#include <set>

#include "rig/runner/bench_check.hpp"
#include "tests/support/runner_rig.hpp"

namespace runner_lidar_test {

using Catch::Matchers::Contains;
using nlohmann::json;
using namespace runner_rig;

TEST_CASE("a lidar that is lost in the middle of a capture comes back and the capture is complete") {
  Rig rig("  - home\n  - capture: {samples: 50}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 40) throw rig::DeviceError("cable pulled.");
  };
  rig.run();
  CHECK(rig.captures()[0].stamps.size() == 50);
  CHECK(rig.lidar.connects == 2);
  CHECK(rig.reported("lidar is back"));
}

TEST_CASE("a lidar that is lost again and again in one way is told once a minute, and recorded every time") {
  Rig rig("  - home\n  - capture: {samples: 80}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 40 || number == 60 || number == 80) throw rig::DeviceError("cable pulled.");
  };
  std::set<std::string> shown;
  rig.prepare = [&](rig::Runner& runner) {
    runner.observe([&](const rig::RunState& state) {
      for (const auto& message : state.messages) shown.insert(std::to_string(message.time_us) + message.text);
    });
  };
  rig.run();
  CHECK(rig.times_reported("lidar lost") == 3);
  CHECK(std::ranges::count_if(shown, [](const std::string& each) {
          return each.find("lidar lost") != std::string::npos;
        }) == 1);
}

TEST_CASE("scans that were lost are counted once: of a capture, of the run, and on the page") {
  Rig rig("  - home\n  - capture: {samples: 50}\n  - capture: {samples: 50}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) {
    rig.lidar.missing += number == 50 ? 2 : number == 100 ? 3 : 0;
  };
  std::uint64_t shown = 0;
  rig.prepare = [&](rig::Runner& runner) {
    runner.observe([&](const rig::RunState& state) { shown = state.scans_lost; });
  };
  rig.run();
  CHECK(rig.reported(": 2 scans were lost on the way"));
  CHECK(rig.reported(": 3 scans were lost on the way"));
  CHECK(rig.times_reported("were lost on the way") == 2);
  CHECK(shown == 5);
}

TEST_CASE("a lidar that is not there yet is waited for when a run begins, for as long as is reported") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.lidar.when_connecting = [&] {
    if (rig.lidar.connects <= 4) throw rig::LidarAbsent("nobody is there");
  };
  CHECK(rig.run());
  CHECK(rig.lidar.connects == 5);
  CHECK(rig.reported("waiting for the lidar: nobody is there. The rig keeps trying for 30 s; Ctrl-C stops."));
  CHECK(rig.reported("still waiting for the lidar, for another 24 s; Ctrl-C stops."));
  CHECK(rig.times_reported("nobody is there") == 1);

  Rig never("  - home\n");
  never.lidar.when_connecting = [] { throw rig::LidarAbsent("nobody is there"); };
  const auto begun_us = never.world.clock.now_us;
  CHECK_THROWS_WITH(never.run(), Contains("nobody is there. The rig waited") && Contains("30 s"));
  CHECK(never.world.clock.now_us - begun_us == 30'000'000);
  CHECK(never.stage.moves.empty());
}

TEST_CASE("a lidar that does answer, and not as it should, is not waited for when a run begins") {
  Rig refused("  - home\n");
  refused.lidar.when_connecting = [] { throw rig::DeviceError("this is a printer."); };
  CHECK_THROWS_WITH(refused.run(), Contains("this is a printer."));
  CHECK(refused.lidar.connects == 1);

  Rig other("  - home\n");
  other.run();
  { rig::SessionStore(other.file, rig::SessionStore::Mode::append).set("lidar", R"({"SERI": "H999"})"); }
  CHECK_THROWS_WITH(other.run(), Contains("another lidar"));
  CHECK(other.lidar.connects == 2);
}

TEST_CASE("a capture that was whole stays whole when the lidar is lost at its end") {
  Rig rig("  - home\n  - capture: {samples: 50}\n  - capture: {samples: 5}\n");
  rig.lidar.fails_at_stop = 2;  // The first stops end the comparison of the clocks and the look at the board.
  CHECK(rig.run());
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 2);
  CHECK(captures[0].step == "capture 2");
  CHECK(captures[0].stamps.size() == 50);
  CHECK(rig.lidar.connects == 2);

  Rig gone("  - home\n  - capture: {samples: 50}\n  - capture: {samples: 5}\n");
  gone.lidar.fails_at_stop = 2;
  gone.lidar.before_scan = [&](std::uint64_t number) { gone.lidar.dead_once_stopped = number > 40; };
  CHECK_THROWS_WITH(gone.run(), Contains("did not come back") && Contains("The stage has stopped."));
  REQUIRE(gone.captures().size() == 1);
  CHECK_THAT(gone.captures()[0].step, !Contains("short"));
}

TEST_CASE("a run that loses both devices does not say that the stage has stopped") {
  Rig rig("  - home\n  - capture: {samples: 50}\n");
  rig.lidar.fails_at_stop = 2;
  rig.lidar.before_scan = [&](std::uint64_t number) {
    rig.lidar.dead_once_stopped = rig.stage.lost_for_good = number > 40;
  };
  CHECK_THROWS_WITH(rig.run(), Contains("did not come back") && !Contains("has stopped"));
  CHECK(rig.reported("The stage could not be stopped: check it."));
}

TEST_CASE("a lidar that is lost while the rig looks at what was placed, or waits, comes back") {
  Rig rig(
      "  - home\n  - prompt: {title: Place it, until: {beams_deg: [-1, 1], within_mm: [1350, 1450]}}\n"
      "  - wait: {seconds: 2}\n  - capture: {samples: 5}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 4 || number == 16 || number == 30) throw rig::DeviceError("cable pulled.");
  };
  CHECK(rig.run());
  CHECK(rig.lidar.connects == 4);
  CHECK(rig.captures()[0].stamps.size() == 5);
}

TEST_CASE("a lidar whose timer jumps by hours in the middle of a capture is connected anew") {
  Rig rig("  - home\n  - capture: {samples: 60}\n");
  int jumps = 0;
  rig.lidar.tamper = [&](lidar::Scan& scan) {
    jumps += rig.world.scans == 40 ? 1 : 0;
    if (jumps > 0) scan.device_ms += 16'000'000;
  };
  CHECK(rig.run());
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK(captures[0].stamps.size() == 60);
  CHECK(rig.lidar.connects == 2);
}

TEST_CASE("a check of the bench stays within soft limits that exclude zero or are not about it") {
  for (const auto& [limits, facing] : std::vector<std::pair<std::pair<double, double>, double>>{
           {{10, 170}, 90}, {{0, 350}, 270}, {{-350, 0}, -90}}) {
    Rig rig("");
    CAPTURE(limits.first, limits.second);
    fit::Target& target = rig.bench.targets[0];
    const double side = facing == 90 ? 1 : -1;
    target.from_mm = {-200, side * 1400}, target.to_mm = {200, side * 1400};
    rig.bench.document = nlohmann::json{{"stage", {{"limits_deg", {limits.first, limits.second}}}}}.dump();
    boost::asio::co_spawn(rig.io,
                          rig::check_bench(rig.bench, rig.lidar, rig.stage, rig.world.clock, false,
                                           [](const rig::CheckLine&) {}),
                          [](std::exception_ptr error, const auto&) {
                            if (error) std::rethrow_exception(error);
                          });
    rig.io.run();
    for (const double deg : rig.stage.moves) CHECK((deg >= limits.first && deg <= limits.second));
    CHECK(std::ranges::count(rig.stage.moves, facing) == 1);
  }
}

TEST_CASE("a check of the bench tells a lidar's clock that jumps from scans that the network lost") {
  const auto check = [](Rig& rig) {
    std::string text;
    boost::asio::co_spawn(
        rig.io,
        rig::check_bench(rig.bench, rig.lidar, rig.stage, rig.world.clock, true,
                         [&](const rig::CheckLine& line) { text += line.what + ": " + line.says + "\n"; }),
        [](std::exception_ptr error, const auto&) {
          if (error) std::rethrow_exception(error);
        });
    rig.io.run();
    return text;
  };
  constexpr std::uint64_t gap = 50;
  Rig jumping("");
  jumping.lidar.tamper = [&](lidar::Scan& scan) {
    if (jumping.world.scans >= 20) scan.device_ms += 25 * gap, jumping.lidar.missing = gap;
  };
  CHECK_THAT(check(jumping), Contains("lidar's clock: its stamps advanced by 2.2 s while 1 s passed here") &&
                                 Contains("scan rate: 40 Hz") && !Contains("scans lost"));
  Rig losing("");
  losing.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 20) losing.world.clock.now_us += 25'000 * gap, losing.lidar.missing = gap;
  };
  CHECK_THAT(check(losing), Contains("scans lost: 50 beside 40 received") && !Contains("lidar's clock"));
}

TEST_CASE("a check of the bench takes a lidar at its stamps and not at the rate that it states") {
  Rig rig("");
  rig.lidar.before_scan = [&](std::uint64_t) {
    rig.world.clock.now_us += 75'000;  // 10 Hz, where 40 Hz are stated: three scans seem lost each time.
    rig.lidar.missing += 3;
  };
  std::string bad;
  boost::asio::co_spawn(rig.io,
                        rig::check_bench(rig.bench, rig.lidar, rig.stage, rig.world.clock, true,
                                         [&](const rig::CheckLine& line) {
                                           if (line.verdict == rig::CheckLine::Verdict::bad)
                                             bad += line.what + ": " + line.says + "\n";
                                         }),
                        [](std::exception_ptr error, const auto&) {
                          if (error) std::rethrow_exception(error);
                        });
  rig.io.run();
  CHECK_THAT(bad, Contains("scan rate: 10 Hz, the bench file says 40 Hz"));
}

TEST_CASE("a wait lasts as long by the host's clock whatever the lidar's stamps say") {
  Rig rig("  - home\n  - wait: {seconds: 60}\n  - capture: {samples: 5}\n");
  rig.lidar.tamper = [&](lidar::Scan& scan) {
    if (rig.world.scans > 50) scan.device_ms += 16'000'000;
  };
  const auto begun_us = rig.world.clock.now_us;
  CHECK(rig.run());
  CHECK(rig.world.clock.now_us - begun_us > 60'000'000);
  CHECK(rig.world.clock.now_us - begun_us < 63'000'000);
}

TEST_CASE("a wait begins again when the lidar restarts in it, is reported, and does not do so for ever") {
  Rig rig("  - home\n  - wait: {seconds: 60}\n  - capture: {samples: 5}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) {
    if (number != 72) return;  // 15 s of the wait have passed.
    rig.lidar.restarts = 1;
    throw rig::DeviceError("cable pulled.");
  };
  const auto begun_us = rig.world.clock.now_us;
  CHECK(rig.run());
  CHECK(rig.world.clock.now_us - begun_us > 74'000'000);
  CHECK(rig.world.clock.now_us - begun_us < 79'000'000);
  CHECK(rig.reported("the lidar's clock started again"));
  CHECK(rig.times_reported("the wait of 60 s begins again") == 1);
  const json restarts =
      json::parse(rig::SessionStore(rig.file, rig::SessionStore::Mode::read).get("lidar_restarts").value());
  REQUIRE(restarts.size() == 1);
  CHECK(restarts[0]["host_us"].get<double>() == Approx(16e6).margin(3e6));

  Rig shaky("  - home\n  - wait: {seconds: 60}\n");
  shaky.lidar.before_scan = [&](std::uint64_t number) {
    if (number % 100 == 99) ++shaky.lidar.restarts;
  };
  CHECK_THROWS_WITH(shaky.run(), Contains("restarted 4 times") && Contains("supply"));
}

TEST_CASE("a restart that a prompt asked for is no cause for concern, any other is reported as one") {
  Rig asked(
      "  - home\n  - prompt: {title: Switch it off and on, place: {since_power_on_s: 30}}\n"
      "  - capture: {samples: 5}\n");
  asked.lidar.when_connecting = [&] { asked.lidar.restarts = asked.lidar.connects - 1; };
  CHECK(asked.run());
  CHECK(asked.reported("the lidar's clock started again"));
  CHECK_FALSE(asked.reported("its power was cut"));
  Rig unasked("  - home\n  - capture: {samples: 50}\n");
  unasked.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 40) unasked.lidar.restarts = 1;
  };
  CHECK(unasked.run());
  CHECK(unasked.times_reported("its power was cut") == 1);
}

TEST_CASE("the session's epoch is the moment from which its host times count") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.world.clock.is_real = true;
  std::map<std::int64_t, std::int64_t> unix_us;  // When the scan with that stamp was made.
  std::int64_t last_ms = 0;
  rig.lidar.tamper = [&](lidar::Scan& scan) {
    std::int64_t apart_us = 0, now_us = 0;
    do {  // A millisecond later than the last, with nothing in between the readings of both clocks.
      scan.host_us = rig.world.clock.host_us();
      now_us = rig.world.clock.unix_us();
      apart_us = rig.world.clock.host_us() - scan.host_us;
    } while (apart_us > 50 || scan.host_us / 1000 <= last_ms);
    last_ms = scan.host_us / 1000;
    scan.device_ms = static_cast<std::uint64_t>(last_ms);
    unix_us[last_ms] = now_us;
  };
  CHECK(rig.run());
  const rig::SessionStore session(rig.file, rig::SessionStore::Mode::read);
  const std::int64_t epoch_us = std::stoll(session.get("epoch_unix_us").value());
  std::vector<std::int64_t> error_us;
  session.for_each_scan(1, [&](const fit::ScanView& scan) {
    error_us.push_back(epoch_us + scan.host_us - unix_us.at(scan.device_ms));
  });
  REQUIRE(error_us.size() == 5);
  std::ranges::sort(error_us);
  INFO("errors from " << error_us.front() << " to " << error_us.back() << " us");
  CHECK(std::abs(error_us[2]) < 1000);
}

TEST_CASE("a capture goes on when the lidar's time begins anew with its connection") {
  Rig rig("  - home\n  - capture: {samples: 60, spacing_s: 0.1}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 40) throw rig::DeviceError("cable pulled.");
  };
  rig.lidar.tamper = [&](lidar::Scan& scan) {
    if (rig.lidar.connects < 2) scan.device_ms += 5'000'000;
  };
  CHECK(rig.run());
  CHECK(rig.captures()[0].stamps.size() == 60);
}

TEST_CASE("scans that are stale or of other beams never enter a capture") {
  Rig rig("  - home\n  - capture: {samples: 30, beams_deg: [-10, -5]}\n");
  rig.lidar.tamper = [&](lidar::Scan& scan) {
    if (rig.world.scans % 5 == 0) scan.device_ms -= 5000;
    if (rig.world.scans % 7 == 0) scan.range_mm.resize(3);
    if (rig.world.scans % 11 == 0) scan.first_step = 0;
    if (rig.world.scans % 13 == 0) scan.host_us -= 60'000'000;
  };
  rig.run();
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK(captures[0].stamps.size() == 30);
  CHECK(std::ranges::is_sorted(captures[0].stamps));
  CHECK(captures[0].beams == 21);
}

TEST_CASE("a lidar whose scans never fit is refused instead of waited for") {
  Rig rig("  - home\n  - capture: {samples: 30, beams_deg: [-10, -5]}\n");
  rig.lidar.tamper = [&](lidar::Scan& scan) { scan.range_mm.resize(2); };
  CHECK_THROWS_WITH(rig.run(), Contains("do not belong"));
}

TEST_CASE("a lidar that the bench file does not describe is refused at once, with what differs") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.lidar.parameters = {{"AMAX", "1080"}, {"AFRT", "540"}, {"ARES", "1440"}};
  CHECK(rig.run());
  Rig another("  - home\n  - capture: {samples: 5}\n");
  another.lidar.parameters = {{"AMAX", "682"}, {"AFRT", "384"}, {"ARES", "1024"}};
  CHECK_THROWS_WITH(another.run(), Contains("steps 1081 where the lidar has 683") &&
                                       Contains("front_step 540 where the lidar has 384") &&
                                       Contains("step_deg 0.25 where the lidar has 0.35"));
  CHECK(another.lidar.connects == 1);
}

TEST_CASE(
    "a lidar that says it is not well is measured with only by the operator's decision, which is recorded") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  for (const char* well : {"Sensor works well.", "sensor is working normally", "Stable 000 no error."}) {
    rig.lidar.information = {{"STAT", well}};
    CHECK(rig.run());
  }
  Rig ill("  - home\n  - capture: {samples: 5}\n");
  ill.lidar.information = {{"STAT", "Window is dirty"}};
  CHECK_THROWS_WITH(ill.run(), Contains("Window is dirty") && Contains("--accept-lidar"));
  CHECK(ill.captures().empty());
  ill.accepts_lidar = true;
  CHECK(ill.run());
  CHECK(ill.captures().size() == 1);
  CHECK(ill.times_reported("by the operator's decision") == 1);
  CHECK_THAT(rig::SessionStore(ill.file, rig::SessionStore::Mode::read).get("lidar_accepted").value(),
             Contains("Window is dirty"));
}

TEST_CASE(
    "a lidar of another model or serial number than the bench states is refused, with where it says so") {
  const auto with = [](const std::string& lidar) {
    fit::Bench bench = small_bench();
    const fit::Bench read =
        fit::parse_bench("{\"schema\": \"bench/1\",\n \"lidar\": {" + lidar + "}}", "my.bench.json");
    bench.lidar = read.lidar, bench.lidar_places = read.lidar_places;
    return bench;
  };
  const auto run = [&](const std::string& lidar) {
    Rig rig("  - home\n  - capture: {samples: 5}\n");
    rig.lidar.parameters = {{"MODL", "UST-20LX(Hokuyo Automatic Co.,Ltd.)"}, {"AMIN", "0"}, {"AMAX", "1080"}};
    rig.bench = with(lidar);
    return rig.run();
  };
  CHECK(run(""));  // Nothing is stated.
  CHECK(run(R"("model": "UST-20LX", "serial": "H123")"));
  CHECK_THROWS_WITH(run(R"("model": "UST-10LX")"),
                    Contains("model UST-10LX (my.bench.json:2:21) where the lidar is a UST-20LX"));
  CHECK_THROWS_WITH(run(R"("serial": "H999")"),
                    Contains("serial H999 (my.bench.json:2:22) where the lidar has H123"));
}

TEST_CASE("a lidar whose first step is not 0 is measured with from that step on") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.lidar.parameters = {
      {"MODL", "URG-04LX"}, {"AMIN", "44"}, {"AMAX", "725"}, {"AFRT", "384"}, {"ARES", "1024"}};
  rig.bench.lidar.steps = 726, rig.bench.lidar.front_step = 384;
  rig.bench.lidar.step_rad = 2 * fit::pi / 1024;
  CHECK_THROWS_WITH(rig.run(), Contains("first_step 0 where the lidar has 44"));
  std::filesystem::remove(rig.file);
  rig.bench.lidar.first_step = 44;
  CHECK(rig.run());
  REQUIRE(rig.captures().size() == 1);
  CHECK(rig.captures()[0].beams == 682);
}

TEST_CASE("a target is looked for by a lidar whose first step is not 0 with the beams that it has") {
  Rig rig(
      "  - home\n  - prompt: {title: Place it, place: {target: board, shift_mm: 0}}\n"
      "  - capture: {samples: 5, target: board}\n");
  rig.bench.lidar.steps = 726, rig.bench.lidar.first_step = 44, rig.bench.lidar.front_step = 384;
  rig.bench.lidar.step_rad = 2 * fit::pi / 1024;
  bool asked_below = false;
  rig.lidar.tamper = [&](lidar::Scan& scan) {
    asked_below |= scan.first_step < 44;
    // Only the beams that meet the board see it, so that one beside them would not do.
    for (int step = scan.first_step; step <= scan.last_step; ++step)
      if (std::abs(step - 384) > 30) scan.range_mm[static_cast<std::size_t>(step - scan.first_step)] = 3000;
  };
  CHECK(rig.run());
  CHECK_FALSE(asked_below);
  CHECK(rig.captures().size() == 1);
}

TEST_CASE("scans that are identical in every beam are measured, with a warning, once a run") {
  Rig frozen("  - home\n  - capture: {samples: 10}\n  - capture: {samples: 10}\n");
  CHECK(frozen.run());
  CHECK(frozen.times_reported("identical in every beam") == 1);
  Rig alive("  - home\n  - capture: {samples: 10}\n");
  alive.lidar.tamper = [&](lidar::Scan& scan) { scan.range_mm[500] += alive.world.scans % 2; };
  CHECK(alive.run());
  CHECK_FALSE(alive.reported("identical in every beam"));
}

TEST_CASE("a check of the bench notes ranges that do not vary, or far less than stated") {
  const auto notes = [](Rig& rig) {
    rig.bench.known = {{"range-noise", {{"sigma_mm", {8, 0}}}, {}}};
    std::string text;
    boost::asio::co_spawn(rig.io,
                          rig::check_bench(rig.bench, rig.lidar, rig.stage, rig.world.clock, true,
                                           [&](const rig::CheckLine& line) {
                                             if (line.verdict == rig::CheckLine::Verdict::note)
                                               text += line.what + ": " + line.says + "\n";
                                           }),
                          [](std::exception_ptr error, const auto&) {
                            if (error) std::rethrow_exception(error);
                          });
    rig.io.run();
    return text;
  };
  Rig frozen("");
  CHECK_THAT(notes(frozen), Contains("noise: none: every beam gives the same range"));
  Rig tame("");
  tame.lidar.tamper = [&](lidar::Scan& scan) { scan.range_mm[500] += tame.world.scans % 2; };
  CHECK_THAT(notes(tame), Contains("noise: 0 mm, the bench file says 8 mm"));
  Rig alive("");
  alive.lidar.tamper = [&](lidar::Scan& scan) {
    for (std::size_t i = 0; i < scan.range_mm.size(); ++i)
      scan.range_mm[i] += static_cast<std::uint16_t>(7 * (alive.world.scans + i) % 20);
  };
  CHECK_THAT(notes(alive), !Contains("noise:"));
}

TEST_CASE("steps that a lidar does not have are no loss of it") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) {
    if (number > 20) throw rig::UsageError("this lidar has steps 44 to 725.");
  };
  CHECK_THROWS_AS(rig.run(), rig::UsageError);
  CHECK(rig.lidar.connects == 1);
}

}  // namespace runner_lidar_test
