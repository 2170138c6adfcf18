// SPDX-License-Identifier: MIT
#include "rig/runner/runner.hpp"

#include <unistd.h>

#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/this_coro.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <future>
#include <nlohmann/json.hpp>

#include "rig/live/session_state.hpp"
#include "rig/runner/operators.hpp"

using Catch::Matchers::Contains;
using nlohmann::json;
namespace asio = boost::asio;
using asio::awaitable;

namespace {

/// Lets everything else that is ready run first.
awaitable<void> yield() {
  auto executor = co_await asio::this_coro::executor;
  co_await asio::post(executor, asio::use_awaitable);
}

class FakeClock final : public rig::RunClock {
 public:
  std::int64_t now_us = 100'000'000;
  bool is_real = false;  ///< The computer's clocks.
  std::int64_t host_us() const override { return is_real ? real->host_us() : now_us; }
  std::int64_t unix_us() const override { return is_real ? real->unix_us() : 1'700'000'000'000'000 + now_us; }
  awaitable<void> sleep(double seconds) override {
    for (int i = 0; i < 10; ++i) co_await yield();  // What happens at once happens before.
    now_us += std::llround(seconds * 1e6);
  }

 private:
  std::unique_ptr<rig::RunClock> real = rig::make_real_clock();
};

/// A bench in a few lines: the range depends on the stage's angle alone.
struct FakeBench {
  FakeClock clock;
  double stage_deg = 0, board_mm = 1400;
  double edge_deg = 1e9;  ///< Below it the followed beam misses the board and sees 2200 mm.
  double window_deg = 0.05;
  double slant_mm_per_deg = 0;  ///< Of the surface behind.
  std::uint64_t scans = 0;
  std::uint16_t range() {
    const double behind = 2200 + slant_mm_per_deg * (edge_deg - stage_deg),
                 inside = (stage_deg - edge_deg) / window_deg + 0.5;
    if (edge_deg > 1e8) return static_cast<std::uint16_t>(board_mm);
    if (inside >= 1 || (inside > 0 && scans % 3 != 0)) return static_cast<std::uint16_t>(board_mm);
    return static_cast<std::uint16_t>(behind);
  }
};

class FakeLidar final : public rig::LidarSource {
 public:
  explicit FakeLidar(FakeBench& bench) : bench_(bench) {}
  std::function<void(std::uint64_t number)> before_scan = [](std::uint64_t) {};
  std::function<void(lidar::Scan&)> tamper = [](lidar::Scan&) {};
  bool dead = false, silent = false, dead_once_stopped = false;
  std::function<void()> when_silent = [] {}, at_cancel = [] {};
  int connects = 0, stops = 0, fails_at_stop = -1;
  json parameters, information;
  rig::LidarStream stream;

  std::function<void()> when_connecting = [] {};
  awaitable<json> connect() override {
    ++connects;
    when_connecting();
    co_await yield();
    if (dead) throw rig::DeviceError("nothing listens at the lidar's address.");
    json who{{"version", {{"SERI", "H123"}}}};
    if (!parameters.empty()) who["PP"] = parameters;
    if (!information.empty()) who["II"] = information;
    co_return who;
  }
  /// What the scans' times are late by since the clocks were last compared: a crystal runs on.
  double drift_ppm = 0;
  std::int64_t compared_us = 0;
  awaitable<void> synchronise() override {
    co_await yield();
    if (dead) throw rig::DeviceError("the lidar is gone.");
    compared_us = bench_.clock.now_us;
  }
  awaitable<void> start(rig::LidarStream wanted) override {
    stream = wanted;
    co_await yield();
    if (dead) throw rig::DeviceError("the lidar is gone.");
  }
  awaitable<lidar::Scan> next() override {
    co_await yield();
    if (silent) {
      when_silent();
      asio::steady_timer never(co_await asio::this_coro::executor, asio::steady_timer::time_point::max());
      boost::system::error_code ended;
      co_await never.async_wait(asio::redirect_error(asio::use_awaitable, ended));
      at_cancel();
      throw boost::system::system_error(ended);
    }
    ++bench_.scans;
    bench_.clock.now_us += 25'000 * (stream.skip + 1);
    before_scan(bench_.scans);
    if (dead) throw rig::DeviceError("the lidar is gone.");
    lidar::Scan scan;
    scan.device_ms = static_cast<std::uint64_t>(bench_.clock.now_us / 1000);
    scan.host_us = bench_.clock.now_us +
                   std::llround(1e-6 * drift_ppm * static_cast<double>(bench_.clock.now_us - compared_us));
    scan.first_step = stream.first_step, scan.last_step = stream.last_step, scan.cluster = stream.cluster;
    scan.range_mm.assign(
        static_cast<std::size_t>((stream.last_step - stream.first_step) / stream.cluster + 1),
        bench_.range());
    scan.intensity.assign(scan.range_mm.size(), 2000);
    tamper(scan);
    co_return scan;
  }
  awaitable<void> stop() override {
    co_await yield();
    if (dead_once_stopped) dead = true;
    if (stops++ == fails_at_stop) throw rig::DeviceError("cable pulled at the end.");
  }
  std::uint64_t missing = 0;
  std::uint64_t lost() const override { return missing; }
  std::uint64_t rejected() const override { return 0; }
  int restarts = 0;
  int clock_restarts() const override { return restarts; }
  bool runs_on_its_own_time = false;
  bool own_time() const override { return runs_on_its_own_time; }

 private:
  FakeBench& bench_;
};

class FakeStage final : public rig::Stage {
 public:
  explicit FakeStage(FakeBench& bench) : bench_(bench) {}
  std::vector<double> moves;
  bool homed = false, moving = false;
  int stops = 0, homings = 0, reopens = 0;
  double readback_error_deg = 0;
  int loses_link_at_move = -1;  ///< Counted from 0.

  awaitable<rig::StageIdentity> identify() override {
    rig::StageIdentity who;
    who.language = "zaber", who.model = "test";
    co_return who;
  }
  bool loses_link_at_status = false;
  int failing_homings = 0;
  awaitable<rig::StageStatus> status() override {
    if (std::exchange(loses_link_at_status, false)) {
      homed = false;
      throw rig::StageLost("the stage does not answer.");
    }
    rig::StageStatus status;
    status.position_deg = bench_.stage_deg, status.homed = homed, status.moving = moving;
    co_return status;
  }
  awaitable<void> home() override {
    ++homings;
    if (failing_homings > 0) {
      --failing_homings;
      throw rig::StageError("homing ended with no reference found.");
    }
    homed = true;
    bench_.stage_deg = 0;
    co_await yield();
  }
  awaitable<double> move_to(double target_deg) override {
    co_await yield();
    if (static_cast<int>(moves.size()) == loses_link_at_move) {
      loses_link_at_move = -1;
      homed = false;
      throw rig::StageLost("the stage does not answer.");
    }
    moves.push_back(target_deg);
    bench_.clock.now_us += 300'000;
    bench_.stage_deg = target_deg;
    co_return target_deg + readback_error_deg;
  }
  double rate_deg_s = 0;
  awaitable<void> turn(double rate) override {
    moving = true;
    rate_deg_s = rate;
    co_await yield();
  }
  awaitable<void> stop() override {
    ++stops;
    moving = false;
    co_await yield();
  }
  awaitable<void> reopen() override {
    ++reopens;
    co_await yield();
  }

 private:
  FakeBench& bench_;
};

class FakeOperator final : public rig::Operator {
 public:
  std::function<rig::Answer(const rig::Prompt&)> answers = [](const rig::Prompt&) { return rig::Answer{}; };
  std::vector<std::string> asked;
  bool nobody = true;
  bool silent = false;  ///< Answers come from elsewhere.
  awaitable<rig::Answer> ask(rig::Prompt prompt) override {
    co_await yield();
    asked.push_back(prompt.title);
    if (silent) {
      asio::steady_timer never(co_await asio::this_coro::executor, asio::steady_timer::time_point::max());
      co_await never.async_wait(asio::use_awaitable);
    }
    co_return answers(prompt);
  }
  bool unattended() const override { return nobody; }
};

fit::Bench small_bench() {
  fit::Bench bench;
  fit::Target board;
  board.name = "board";
  board.from_mm = {1400, -200}, board.to_mm = {1400, 200};
  bench.targets = {board};
  bench.document = R"({"stage": {"limits_deg": [-170, 170], "speed_deg_s": 20}})";
  return bench;
}

/// One session file and the fakes around it; run() may be called again to resume.
struct Rig {
  FakeBench world;
  FakeLidar lidar{world};
  FakeStage stage{world};
  FakeOperator person;
  std::string text;
  std::filesystem::path file;
  std::function<void(rig::Runner&)> prepare = [](rig::Runner&) {};
  json fitted = {{"values", json::array()}};
  std::function<json(const std::string&, const rig::SessionStore&, const json&)> fit =
      [this](const std::string&, const rig::SessionStore&, const json&) { return fitted; };
  asio::io_context io{1};
  bool accepts_lidar = false, doubts_bench = false;
  fit::Bench bench = small_bench();
  std::function<void()> when_ended = [] {};  ///< The run has ended, the runner is still there.

  explicit Rig(const std::string& steps, const std::string& head = "")
      : text("procedure: test\n" + head + "steps:\n" + steps) {
    static int number = 0;
    file = std::filesystem::temp_directory_path() /
           ("runner-test-" + std::to_string(getpid()) + "-" + std::to_string(++number) + ".rig");
    std::filesystem::remove(file);
  }
  ~Rig() {
    for (const char* ending : {"", "-wal", "-shm"}) std::filesystem::remove(file.string() + ending);
  }

  bool run() {
    const bool again = std::filesystem::exists(file);
    rig::SessionStore session(file,
                              again ? rig::SessionStore::Mode::append : rig::SessionStore::Mode::create);
    rig::RunnerParts parts{lidar,  stage, world.clock,
                           person, fit,   [](const std::string&, const std::string&) { return rig::RunnerParts::Written{}; },
                           accepts_lidar, doubts_bench};
    rig::Runner runner(rig::parse_procedure(text, "test.yaml"), bench, session, parts);
    prepare(runner);
    std::exception_ptr why;
    bool met = false, ended = false;
    io.restart();
    asio::co_spawn(io, runner.run(),
                   [&](std::exception_ptr error, bool result) { why = error, met = result, ended = true; });
    io.run();
    when_ended();
    REQUIRE(ended);
    if (why) std::rethrow_exception(why);
    return met;
  }

  struct Seen {
    std::string step;
    double stage_deg = 0;
    int approach = 0;
    std::vector<std::int64_t> stamps;
    std::size_t beams = 0;
    std::uint16_t range = 0;
    double shift_mm = 0;
    std::optional<double> since_power_on_s;
  };
  std::vector<Seen> captures() const {
    const rig::SessionStore session(file, rig::SessionStore::Mode::read);
    const auto recording = session.recording();
    std::vector<Seen> all;
    for (std::size_t i = 0; i < recording->captures().size(); ++i) {
      const fit::CaptureInfo& info = recording->captures()[i];
      Seen seen;
      seen.step = info.step;
      seen.stage_deg = std::round(info.stage_rad * fit::deg_per_rad * 1e6) / 1e6;
      seen.approach = info.approach;
      seen.shift_mm = info.target_shift_mm;
      seen.since_power_on_s = info.since_power_on_s;
      recording->for_each_scan(i, [&](const fit::ScanView& scan) {
        seen.stamps.push_back(scan.device_ms);
        seen.beams = scan.range_mm.size();
        seen.range = scan.range_mm[0];
      });
      all.push_back(seen);
    }
    return all;
  }
  int times_told(const std::string& words) const {
    const rig::SessionStore session(file, rig::SessionStore::Mode::read);
    int times = 0;
    for (const auto& event : session.events()) times += event.text.find(words) != std::string::npos;
    return times;
  }
  bool told(const std::string& words) const { return times_told(words) > 0; }
};

}  // namespace

TEST_CASE("a capture holds exactly the scans and beams that were asked for") {
  Rig rig("  - home\n  - capture: {samples: 25, beams_deg: [-10, -5]}\n");
  CHECK(rig.run());
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK(captures[0].stamps.size() == 25);
  CHECK(captures[0].beams == 21);
  CHECK(rig.stage.stops >= 1);
}

TEST_CASE("a for-each that comes to a value again measures there again") {
  Rig rig(
      "  - home\n  - for-each: {at_deg: [-5, 0, 5, 0]}\n    steps:\n      - move: {to_deg: \"${at_deg}\"}\n"
      "      - capture: {samples: 3}\n");
  CHECK(rig.run());
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 4);
  CHECK(captures[3].stage_deg == 0);
  CHECK(captures[3].approach == captures[1].approach);  // from the procedure's side, from wherever it came
}

TEST_CASE("every stop of a sweep is reached from the same side") {
  Rig rig("  - home\n  - sweep: {start_deg: 1, stop_deg: 0, step_deg: 0.25, samples: 2}\n");
  rig.run();
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 5);
  for (const auto& capture : captures) CHECK(capture.approach == 1);
  CHECK(captures[4].stage_deg == 0);
}

TEST_CASE("a lidar that is lost in the middle of a capture comes back and the capture is complete") {
  Rig rig("  - home\n  - capture: {samples: 50}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 40) throw rig::DeviceError("cable pulled.");
  };
  rig.run();
  CHECK(rig.captures()[0].stamps.size() == 50);
  CHECK(rig.lidar.connects == 2);
  CHECK(rig.told("lidar is back"));
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
  CHECK(rig.told(": 2 scans were lost on the way"));
  CHECK(rig.told(": 3 scans were lost on the way"));
  CHECK(rig.times_told("were lost on the way") == 2);
  CHECK(shown == 5);
}

TEST_CASE("a lidar that is not there yet is waited for when a run begins, for as long as is told") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.lidar.when_connecting = [&] {
    if (rig.lidar.connects <= 4) throw rig::LidarAbsent("nobody is there");
  };
  CHECK(rig.run());
  CHECK(rig.lidar.connects == 5);
  CHECK(rig.told("waiting for the lidar: nobody is there. The rig keeps trying for 30 s; Ctrl-C stops."));
  CHECK(rig.told("still waiting for the lidar, for another 24 s; Ctrl-C stops."));
  CHECK(rig.times_told("nobody is there") == 1);

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
  CHECK_THROWS_WITH(refused.run(), "this is a printer.");
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
  CHECK_THROWS_WITH(gone.run(), Contains("did not come back"));
  REQUIRE(gone.captures().size() == 1);
  CHECK_THAT(gone.captures()[0].step, !Contains("short"));
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

TEST_CASE("a turning stage is stopped at its soft limit even if the lidar says nothing") {
  Rig rig("  - home\n  - turn: {rate_deg_s: 20, from_deg: 100, samples: 40}\n");
  rig.prepare = [&](rig::Runner& runner) {
    runner.observe(
        [&](const rig::RunState& state) { rig.lidar.silent = state.activity.starts_with("turning"); });
  };
  CHECK_THROWS_WITH(rig.run(), Contains("soft limit"));
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
  CHECK(rig.told("repeated from its start"));
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

TEST_CASE("a wait begins again when the lidar restarts in it, is told, and does not do so for ever") {
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
  CHECK(rig.told("the lidar's clock started again"));
  CHECK(rig.times_told("the wait of 60 s begins again") == 1);
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

TEST_CASE("a restart that a prompt asked for is no cause for concern, any other is told as one") {
  Rig asked(
      "  - home\n  - prompt: {title: Switch it off and on, place: {since_power_on_s: 30}}\n"
      "  - capture: {samples: 5}\n");
  asked.lidar.when_connecting = [&] { asked.lidar.restarts = asked.lidar.connects - 1; };
  CHECK(asked.run());
  CHECK(asked.told("the lidar's clock started again"));
  CHECK_FALSE(asked.told("its power was cut"));
  Rig unasked("  - home\n  - capture: {samples: 50}\n");
  unasked.lidar.before_scan = [&](std::uint64_t number) {
    if (number == 40) unasked.lidar.restarts = 1;
  };
  CHECK(unasked.run());
  CHECK(unasked.times_told("its power was cut") == 1);
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

TEST_CASE("a lidar that stays away ends the run safely, and a resumed run replaces the short capture") {
  Rig rig("  - home\n  - capture: {samples: 50}\n  - capture: {samples: 5}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 40; };
  CHECK_THROWS_WITH(rig.run(), Contains("did not come back") && Contains("rig resume"));
  CHECK(rig.stage.stops >= 1);
  auto captures = rig.captures();
  REQUIRE(captures.size() == 1);
  CHECK_THAT(captures[0].step, Contains("(short)"));
  CHECK(captures[0].stamps.size() < 50);

  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  rig.run();
  captures = rig.captures();
  REQUIRE(captures.size() == 2);
  CHECK(captures[0].stamps.size() == 50);
  CHECK_THAT(captures[0].step, !Contains("(short)"));
}

TEST_CASE("what was recorded is not measured again by a resumed run") {
  Rig rig(
      "  - home\n  - sweep: {start_deg: 0, stop_deg: 1, step_deg: 0.1, samples: 10}\n"
      "  - capture: {samples: 10}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 60; };
  CHECK_THROWS(rig.run());
  const auto before = rig.captures();
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  rig.run();
  const auto after = rig.captures();
  REQUIRE(after.size() == 12);
  for (std::size_t i = 0; i + 1 < before.size(); ++i) CHECK(after[i].stamps == before[i].stamps);
  CHECK(after[11].stage_deg == 1);
}

TEST_CASE("a resumed run says how many captures are done, which step is next and with which variables") {
  Rig rig(
      "  - home\n"
      "  - for-each: {d: [1, 2]}\n"
      "    steps:\n"
      "      - prompt: {title: 'Place ${d}', ask: {name: rail, default: 7.5}}\n"
      "      - sweep: {start_deg: 0, stop_deg: 1, step_deg: 0.5, samples: 10}\n");
  rig.lidar.before_scan = [&](std::uint64_t) { rig.lidar.dead = rig.stage.moves.size() >= 7; };
  CHECK_THROWS(rig.run());
  REQUIRE(rig.captures().size() >= 4);
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  CHECK(rig.run());
  CHECK(rig.told("resumed: 4 of 6 captures are done; next is step 5 of 5, sweep"));
  CHECK(rig.told(", with d = 2, rail = 7.5"));
  CHECK(rig.run());
  CHECK(rig.told("resumed: all 6 captures and all 5 steps are done already"));
}

TEST_CASE("a resumed run refuses another procedure") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.run();
  rig.text += "  - capture: {samples: 6}\n";
  CHECK_THROWS_WITH(rig.run(), Contains("differs from the procedure"));
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

TEST_CASE("a stage that is found moving is stopped before anything else") {
  Rig rig("  - home\n  - capture: {samples: 5}\n");
  rig.stage.moving = true;
  rig.run();
  CHECK(rig.told("found moving"));
}

TEST_CASE("an abort stops the stage, keeps what was captured and says how to go on") {
  Rig rig("  - home\n  - capture: {samples: 500}\n");
  rig.prepare = [&](rig::Runner& runner) {
    rig.lidar.before_scan = [&](std::uint64_t number) {
      if (number == 100) runner.abort();
    };
  };
  CHECK_THROWS_AS(rig.run(), rig::RunStopped);
  CHECK(rig.stage.stops >= 1);
  CHECK(rig.lidar.stops >= 1);
  REQUIRE(rig.captures().size() == 1);
  CHECK_THAT(rig.captures()[0].step, Contains("(short)"));
}

TEST_CASE("a pause holds the run at the next checkpoint until it is resumed") {
  Rig rig("  - home\n  - sweep: {start_deg: 0, stop_deg: 1, step_deg: 0.5, samples: 3}\n");
  bool paused = false;
  rig.prepare = [&](rig::Runner& runner) {
    rig.lidar.before_scan = [&](std::uint64_t number) {
      if (number == 14) runner.pause();
    };
    runner.observe([&](const rig::RunState& state) {
      if (state.phase != rig::RunState::Phase::paused || std::exchange(paused, true)) return;
      runner.resume();
    });
  };
  rig.run();
  CHECK(paused);
  CHECK(rig.captures().size() == 3);
}

TEST_CASE("a prompt is asked again until the rig sees what was asked for") {
  Rig rig(
      "  - home\n"
      "  - prompt: {title: Place it, place: {target: board, shift_mm: 100}, until: {beams_deg: [-1, "
      "1], "
      "within_mm: "
      "[1450, 1550]}}\n"
      "  - capture: {samples: 5, target: board}\n");
  rig.person.answers = [&](const rig::Prompt& prompt) {
    if (!prompt.check.empty()) rig.world.board_mm = 1500;
    return rig::Answer{};
  };
  rig.run();
  CHECK(rig.person.asked.size() == 2);
  CHECK(rig.captures()[0].range == 1500);
  CHECK(rig.captures()[0].shift_mm == 100);
}

TEST_CASE("a prompt that places a target is done when the target is seen there, and says what is seen instead") {
  Rig rig(
      "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 1600}}\n"
      "  - capture: {samples: 5, target: board}\n");
  std::vector<std::string> refused;
  rig.person.nobody = false;
  rig.person.answers = [&](const rig::Prompt& prompt) {
    refused.push_back(prompt.refusal);
    if (refused.size() == 3) rig.world.board_mm = 1600;
    return rig::Answer{};
  };
  CHECK(rig.run());
  REQUIRE(refused.size() == 3);
  CHECK(refused[0].empty());
  CHECK_THAT(refused[1], Contains("'board' is not in its place") && Contains("nearer than asked") &&
                             Contains("instead of 1600 mm"));
  CHECK(rig.captures()[0].range == 1600);
}

TEST_CASE("an unattended run ends where a target is not in place, without having measured it") {
  Rig placed(
      "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 5000}}\n"
      "  - capture: {samples: 5, target: board}\n");
  CHECK_THROWS_WITH(placed.run(), Contains("instead of 5000 mm") && Contains("Unattended run: cannot be corrected"));
  CHECK(placed.captures().empty());
  // One that no prompt places is looked at before the first capture.
  Rig standing("  - home\n  - capture: {samples: 5, target: board}\n");
  standing.world.board_mm = 1800;
  CHECK_THROWS_WITH(standing.run(), Contains("'board' is not in its place") && Contains("farther away"));
  CHECK(standing.captures().empty());
  standing.world.board_mm = 1400;
  CHECK(standing.run());
}

TEST_CASE("where the bench file is in question, what is not seen in its place is told and measured all the same") {
  Rig standing("  - home\n  - capture: {samples: 5, target: board}\n");
  standing.doubts_bench = true;
  standing.world.board_mm = 1800;
  std::string warned;
  standing.prepare = [&](rig::Runner& runner) {
    runner.observe([&](const rig::RunState& state) {
      for (const auto& message : state.messages)
        if (message.level == "warning") warned = message.text;
    });
  };
  CHECK(standing.run());
  CHECK_THAT(warned, Contains("'board' is not in its place") && Contains("farther away"));
  CHECK(standing.captures()[0].range == 1800);
  // At a prompt: said once, and a second confirmation counts.
  Rig placed(
      "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 1600}}\n"
      "  - capture: {samples: 5, target: board}\n");
  placed.doubts_bench = true;
  placed.person.nobody = false;
  std::vector<std::string> refused;
  placed.person.answers = [&](const rig::Prompt& prompt) {
    refused.push_back(prompt.refusal);
    return rig::Answer{};
  };
  CHECK(placed.run());
  REQUIRE(refused.size() == 2);
  CHECK_THAT(refused[1], Contains("instead of 1600 mm") && Contains("confirm again"));
  CHECK(placed.captures()[0].range == placed.world.board_mm);
}

TEST_CASE("a target that stood in its place before an interruption is looked at before the run goes on") {
  Rig rig(
      "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 1600}}\n"
      "  - capture: {samples: 5, target: board}\n  - capture: {samples: 5, target: board}\n");
  rig.world.board_mm = 1600;
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 32; };
  CHECK_THROWS(rig.run());
  REQUIRE(rig.captures().size() >= 1);
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  rig.world.board_mm = 1400;
  CHECK_THROWS_WITH(rig.run(), Contains("instead of 1600 mm"));
  rig.world.board_mm = 1600;
  CHECK(rig.run());
}

TEST_CASE("a surface whose echo does not follow its stated reflectance is told, unless the procedure says otherwise") {
  const auto steps = [](const std::string& until) {
    return "  - home\n  - for-each: {r: [0.9, 0.2]}\n    steps:\n"
           "      - prompt: {title: Place it, place: {target: board, shift_mm: 0, reflectance: "
           "'${r}'}" +
           until + "}\n      - capture: {samples: 5, target: board}\n";
  };
  Rig same(steps(""));
  CHECK_THROWS_WITH(same.run(), Contains("its echo is 2000") && Contains("0.2 is requested"));
  CHECK(same.captures().size() == 1);
  Rig changed(steps(""));
  changed.lidar.tamper = [&](lidar::Scan& scan) {
    if (changed.person.asked.size() > 1) scan.intensity.assign(scan.intensity.size(), 700);
  };
  CHECK(changed.run());
  Rig unasked(steps(", until: {surface: false}"));
  CHECK(unasked.run());
}

TEST_CASE("a or q at a prompt stops the run") {
  Rig rig("  - home\n  - prompt: {title: Place it}\n  - capture: {samples: 5}\n");
  rig.person.nobody = false;
  rig.person.answers = [&](const rig::Prompt&) {
    rig::Answer answer;
    answer.kind = rig::Answer::Kind::abort;
    return answer;
  };
  CHECK_THROWS_AS(rig.run(), rig::RunStopped);
  CHECK(rig.person.asked.size() == 1);
  CHECK(rig.stage.stops >= 1);
  rig.person.answers = [](const rig::Prompt&) { return rig::Answer{}; };
  CHECK(rig.run());
}

TEST_CASE("an answer out of its range is told with the range") {
  Rig rig("  - home\n  - prompt: {title: Measure it, ask: {name: rail, unit: mm, min: 150, max: 400}}\n");
  std::vector<std::string> refused;
  rig.person.nobody = false;
  rig.person.answers = [&](const rig::Prompt& prompt) {
    refused.push_back(prompt.refusal);
    rig::Answer answer;
    answer.value = refused.size() == 1 ? 900.0 : 300.0;
    return answer;
  };
  CHECK(rig.run());
  CHECK(refused == std::vector<std::string>{"", "900 mm is outside 150 to 400 mm."});
}

TEST_CASE("a resumed run with other variables is refused, and which differ is told") {
  Rig rig("  - home\n  - capture: {samples: '${samples}'}\n", "variables: {samples: 5, far: 2}\n");
  rig.run();
  { rig::SessionStore(rig.file, rig::SessionStore::Mode::append).set("variables", R"({"samples": 7, "far": 2})"); }
  CHECK_THROWS_WITH(rig.run(), Contains("samples was 7 and is 5 now") && !Contains("far"));
}

TEST_CASE("captures know how long the lidar has been on once a prompt has said so, in a resumed run too") {
  Rig rig(
      "  - home\n  - capture: {samples: 5}\n"
      "  - prompt: {title: Switch it off and on, place: {since_power_on_s: 30}}\n"
      "  - capture: {samples: 5}\n  - wait: {seconds: 100}\n  - capture: {samples: 50}\n");
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = number >= 60; };
  CHECK_THROWS(rig.run());
  CHECK(rig.lidar.connects >= 2);  // Who was switched off is connected to anew, and that is no fault.
  CHECK(rig.told("the lidar was switched off and on"));
  rig.lidar.dead = false;
  rig.lidar.before_scan = [](std::uint64_t) {};
  CHECK(rig.run());
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 3);
  CHECK_FALSE(captures[0].since_power_on_s);
  REQUIRE(captures[1].since_power_on_s);
  REQUIRE(captures[2].since_power_on_s);
  CHECK(*captures[1].since_power_on_s == Approx(30).margin(1));
  const auto passed_s = static_cast<double>(captures[2].stamps[0] - captures[1].stamps[0]) / 1e3;
  CHECK(*captures[2].since_power_on_s - *captures[1].since_power_on_s == Approx(passed_s).margin(1));
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
  CHECK(ill.times_told("by the operator's decision") == 1);
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

TEST_CASE("nobody is asked for ever: a bench that contradicts the captures ends the run") {
  Rig rig(
      "  - home\n  - prompt: {title: Place it, until: {beams_deg: [-1, 1], within_mm: [1450, "
      "1550]}}\n");
  CHECK_THROWS_WITH(rig.run(), Contains("sees 1400 mm") && Contains("expected 1450 to 1550"));
}

TEST_CASE(
    "while a person works, the rig tells what it sees, and a lidar that was unplugged meanwhile comes back") {
  Rig rig(
      "  - home\n  - prompt: {title: Place it, place: {target: board, at_mm: 1500}, until: "
      "{beams_deg: [-1, 1], "
      "within_mm: [1450, 1550]}}\n"
      "  - capture: {samples: 5}\n");
  rig.person.nobody = false;
  rig.person.silent = true;
  std::vector<std::string> wrong;
  rig.lidar.before_scan = [&](std::uint64_t number) { rig.lidar.dead = rig.lidar.dead || number == 60; };
  rig.prepare = [&](rig::Runner& runner) {
    runner.observe([&](const rig::RunState& state) {
      if (!state.prompt) return;
      if (!state.prompt->check.empty()) wrong.push_back(state.prompt->check);
      if (rig.lidar.dead && state.prompt->check.find("does not answer") != std::string::npos) {
        rig.lidar.dead = false;
        rig.world.board_mm = 1500;
      }
      if (!state.prompt->seen.empty() && state.reconnects == 1) runner.answer(rig::Answer{});
    });
  };
  CHECK(rig.run());
  REQUIRE_FALSE(wrong.empty());
  CHECK(wrong.front() == "the rig sees 1400 mm, expected 1450 to 1550 mm.");
  CHECK(rig.told("lidar lost"));
  CHECK(rig.told("lidar is back"));
  REQUIRE(rig.captures().size() == 1);
  CHECK(rig.captures()[0].range == 1500);
  CHECK(rig.captures()[0].stamps.size() == 5);
}

TEST_CASE("skipping a prompt skips the rest of its turn only") {
  Rig rig(
      "  - home\n"
      "  - for-each: {d: [1, 2, 3]}\n"
      "    steps:\n"
      "      - prompt: {title: 'Place ${d}'}\n"
      "      - capture: {samples: 5}\n"
      "        name: 'at ${d}'\n");
  rig.person.answers = [](const rig::Prompt& prompt) {
    rig::Answer answer;
    if (prompt.title == "Place 2") answer.kind = rig::Answer::Kind::skipped;
    return answer;
  };
  rig.run();
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 2);
  CHECK(captures[0].step == "at 1");
  CHECK(captures[1].step == "at 3");
}

TEST_CASE("a repeated turn is measured again and the first measurement is kept under another name") {
  Rig rig(
      "  - home\n"
      "  - for-each: {d: [1, 2]}\n"
      "    steps:\n"
      "      - prompt: {title: 'Place ${d}'}\n"
      "      - capture: {samples: 5}\n"
      "        name: 'at ${d}'\n");
  bool repeated = false;
  rig.person.answers = [&](const rig::Prompt& prompt) {
    rig::Answer answer;
    if (prompt.title == "Place 2" && !std::exchange(repeated, true))
      answer.kind = rig::Answer::Kind::repeat;
    return answer;
  };
  rig.run();
  const auto captures = rig.captures();
  REQUIRE(captures.size() == 3);
  CHECK_THAT(captures[0].step, Contains("(repeated)"));
  CHECK(captures[1].step == "at 1");
  CHECK(captures[2].step == "at 2");
}

TEST_CASE("an edge is found with its window, and again from the same captures when resumed") {
  const std::string steps =
      "  - home\n  - find-edge: {target: board, beam_deg: 0, samples: 60}\n"
      "  - move: {to_deg: '${edge_smooth_deg}'}\n  - capture: {samples: 5}\n";
  Rig whole(steps);
  // The board's right end, (1400, -200), is seen by beam 0 at -8.13 deg.
  whole.world.edge_deg = -8.2;
  whole.run();
  const double smooth_deg = whole.captures().back().stage_deg;
  CHECK(smooth_deg == Approx(-8.2 + 0.025).margin(0.0101));

  Rig broken(steps);
  broken.world.edge_deg = -8.2;
  broken.lidar.before_scan = [&](std::uint64_t number) { broken.lidar.dead = number >= 400; };
  CHECK_THROWS(broken.run());
  broken.lidar.dead = false;
  broken.lidar.before_scan = [](std::uint64_t) {};
  broken.run();
  CHECK(broken.captures().back().stage_deg == Approx(smooth_deg).margin(0.0101));
}

TEST_CASE("the edge's window is found although the surface behind is slanted") {
  Rig rig(
      "  - home\n  - find-edge: {target: board, beam_deg: 0, samples: 60, search_deg: 3}\n"
      "  - move: {to_deg: '${edge_background_deg}'}\n  - capture: {samples: 5}\n");
  rig.world.edge_deg = -8.2;
  rig.world.slant_mm_per_deg = 15;
  rig.run();
  CHECK(rig.captures().back().stage_deg == Approx(-8.2 - 0.025).margin(0.0101));
}

TEST_CASE("samples may be spaced out in time") {
  Rig rig("  - home\n  - capture: {samples: 10, spacing_s: 0.5}\n");
  rig.run();
  const auto stamps = rig.captures()[0].stamps;
  for (std::size_t i = 1; i < stamps.size(); ++i) CHECK(stamps[i] - stamps[i - 1] == 500);
}

TEST_CASE("a limit that is not met is the run's result, not an error") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n",
          "limits:\n  - {name: noise, of: noise.sigma, max: 5}\n");
  rig.fitted = {{"schema", "result/1"},
                {"kind", "noise"},
                {"values", {{{"name", "sigma"}, {"value", 9.0}, {"u", 0.1}, {"unit", "mm"}}}}};
  CHECK_FALSE(rig.run());
  rig.fitted["values"][0]["value"] = 3.0;
  Rig good("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n",
           "limits:\n  - {name: noise, of: noise.sigma, max: 5}\n");
  good.fitted = rig.fitted;
  CHECK(good.run());
}

TEST_CASE("while a fit computes, whatever else is ready is served") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n");
  std::size_t captures_seen = 0;
  bool served_meanwhile = false;
  rig.fit = [&](const std::string&, const rig::SessionStore& session, const json&) {
    const auto served = std::make_shared<std::promise<void>>();
    const auto waiting = served->get_future();
    asio::post(rig.io, [served] { served->set_value(); });
    served_meanwhile = waiting.wait_for(std::chrono::seconds(60)) == std::future_status::ready;
    captures_seen = session.recording()->captures().size();
    return rig.fitted;
  };
  CHECK(rig.run());
  CHECK(served_meanwhile);
  CHECK(captures_seen == 1);
}

TEST_CASE("an abort while a fit computes is answered at once, and what the fit gives is thrown away") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n");
  rig::Runner* running = nullptr;
  rig.prepare = [&](rig::Runner& runner) { running = &runner; };
  std::promise<void> ended;
  const auto end = ended.get_future().share();
  bool ended_before_the_fit = false;
  rig.fit = [&](const std::string&, const rig::SessionStore&, const json&) {
    asio::post(rig.io, [&] { running->abort(); });
    ended_before_the_fit = end.wait_for(std::chrono::seconds(60)) == std::future_status::ready;
    return rig.fitted;
  };
  rig.when_ended = [&] { ended.set_value(); };
  CHECK_THROWS_AS(rig.run(), rig::RunStopped);
  CHECK(ended_before_the_fit);
  CHECK(rig.stage.stops >= 1);
  CHECK_FALSE(rig::SessionStore(rig.file, rig::SessionStore::Mode::read).latest_result("noise"));
  CHECK_FALSE(std::filesystem::exists(rig.file.string() + "-wal"));  // One plain file, as after every run.
  rig.fit = [&](const std::string&, const rig::SessionStore&, const json&) { return rig.fitted; };
  rig.when_ended = [] {};
  CHECK(rig.run());
  CHECK(rig.captures().size() == 1);
}

TEST_CASE("what a fit says against the data ends the run in its own words, and the devices are safe") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n");
  rig.fit = [](const std::string&, const rig::SessionStore&, const json&) -> json {
    throw rig::MeasurementError("too few captures.");
  };
  CHECK_THROWS_AS(rig.run(), rig::MeasurementError);
  CHECK_THROWS_WITH(rig.run(), "too few captures.");
  CHECK(rig.stage.stops >= 2);
}

TEST_CASE(
    "a limit tells what was measured, what is allowed, and by how much and on which side it is missed") {
  struct Row {
    std::optional<double> min, max, max_expanded, u;
    bool guarded;
    std::string verdict, text;
  };
  const std::vector<Row> rows = {
      {{},
       5,
       {},
       0.1,
       false,
       "fail",
       "9.00 ± 0.20 mm; allowed: at most 5 mm; 4.00 mm above the largest value allowed"},
      {10,
       {},
       {},
       0.1,
       false,
       "fail",
       "9.00 ± 0.20 mm; allowed: at least 10 mm; 1.00 mm below the smallest value allowed"},
      {8, 10, {}, 0.1, true, "pass", "9.00 ± 0.20 mm; allowed: 8 to 10 mm"},
      {9.1,
       12,
       {},
       0.1,
       true,
       "inconclusive",
       "9.00 ± 0.20 mm; allowed: 9.1 to 12 mm; 0.10 mm below the smallest value allowed, within the guard "
       "band "
       "of 0.20 mm"},
      {1,
       9.1,
       {},
       0.1,
       true,
       "inconclusive",
       "9.00 ± 0.20 mm; allowed: 1 to 9.1 mm; 0.10 mm below the largest value allowed, within the guard band "
       "of 0.20 mm"},
      {{},
       10,
       0.1,
       0.1,
       false,
       "fail",
       "9.00 ± 0.20 mm; allowed: at most 10 mm, U at most 0.1 mm; its uncertainty is larger than the 0.1 mm "
       "allowed"},
      {{},
       {},
       0.1,
       {},
       false,
       "fail",
       "9 mm; allowed: U at most 0.1 mm; its uncertainty is not known, and at most 0.1 mm is allowed"},
      {{},
       10,
       {},
       {},
       true,
       "inconclusive",
       "9 mm; allowed: at most 10 mm; its uncertainty is not known, and so its guard band is not"}};
  for (const Row& row : rows) {
    const Rig rig("  - home\n");
    rig::SessionStore session(rig.file, rig::SessionStore::Mode::create);
    json value = {{"name", "sigma"}, {"value", 9.0}, {"unit", "mm"}};
    if (row.u) value["u"] = *row.u;
    session.add_result("noise", json{{"values", {value}}}.dump());
    rig::Limit limit;
    limit.name = "noise", limit.kind = "noise", limit.value = "sigma";
    limit.min = row.min, limit.max = row.max, limit.max_expanded = row.max_expanded;
    limit.guarded = row.guarded;
    const json check = rig::check_limits({limit}, session)["checks"][0];
    CHECK(check["verdict"] == row.verdict);
    CHECK(check["text"] == row.text);
  }
}

TEST_CASE("who watches a session sees the procedure's steps, and limits with figures and verdict") {
  Rig rig("  - home\n  - capture: {samples: 5}\n  - fit: {kind: noise}\n  - wait: {seconds: 1}\n",
          "limits:\n  - {name: noise, of: noise.sigma, max: 5}\n");
  rig.fitted = {{"schema", "result/1"},
                {"kind", "noise"},
                {"values", {{{"name", "sigma"}, {"value", 9.0}, {"u", 0.1}, {"unit", "mm"}}}}};
  json live;
  rig.prepare = [&](rig::Runner& runner) {
    runner.observe([&](const rig::RunState& state) { live = rig::to_json(state, small_bench()); });
  };
  CHECK_FALSE(rig.run());
  const std::string figures =
      "9.00 ± 0.20 mm; allowed: at most 5 mm; 4.00 mm above the largest value allowed";
  const json row = {{"name", "noise"}, {"text", figures}, {"verdict", "fail"}};
  CHECK(live["results"] == json::array({row}));  // In braces compilers disagree on what it is.
  const json watched = rig::state_of(rig::SessionStore(rig.file, rig::SessionStore::Mode::read));
  CHECK(watched["results"] == json{{{"name", "sigma"}, {"text", "9.00 ± 0.20 mm"}}, row});
  CHECK(watched["step"]["n"] == 4);
  CHECK(watched["step"]["of"] == 4);
  REQUIRE(watched["steps"].size() == 4);
  CHECK(watched["steps"][1] == json{{"number", "2"}, {"text", "capture 5 scans"}, {"state", "recorded"}});
}

TEST_CASE("a session that is removed after the last capture is saved before the run ends") {
  const std::string last = GENERATE("", "  - fit: {kind: noise}\n", "  - report: {file: test.html}\n");
  Rig rig("  - home\n  - capture: {samples: 5}\n  - move: {to_deg: 5}\n" + last);
  rig.prepare = [&rig](rig::Runner& runner) {
    runner.observe([&rig](const rig::RunState& state) {
      if (state.stage_deg > 4) std::filesystem::remove(rig.file);
    });
  };
  CHECK_THROWS_WITH(rig.run(), Contains("was removed") && Contains(".rescued"));
  rig.prepare = [](rig::Runner&) {};
  std::filesystem::rename(rig.file.string() + ".rescued", rig.file);
  CHECK(rig.run());
  CHECK(rig.captures().size() == 1);
}

TEST_CASE("a report cannot leave the session's folder, and is refused before anything moves") {
  for (const char* file :
       {"/tmp/report.html", "../report.html", "a/../../report.html", "report.exe", "bench.json/.."}) {
    INFO(file);
    Rig rig("  - home\n  - report: {file: '" + std::string(file) + "'}\n");
    CHECK_THROWS_WITH(rig.run(), Contains("test.yaml:4:"));
    CHECK(rig.stage.homings == 0);
  }
}

TEST_CASE("a report does not follow a link out of the session's folder") {
  const std::string name = "runner-test-link-" + std::to_string(getpid());
  const auto link = std::filesystem::temp_directory_path() / name;
  for (const char* there : {"/usr", "/tmp/.."}) {
    std::filesystem::create_directory_symlink(there, link);
    Rig rig("  - home\n  - report: {file: '" + name + "/report.html'}\n");
    CHECK_THROWS_WITH(rig.run(), Contains("outside the session's folder"));
    std::filesystem::remove(link);
  }
  const auto report = link.string() + ".html";
  std::filesystem::create_symlink("/nowhere/report.html", report);
  Rig rig("  - home\n  - report: {file: '" + name + ".html'}\n");
  CHECK_THROWS_WITH(rig.run(), Contains("outside the session's folder"));
  std::filesystem::remove(report);
}
