// SPDX-License-Identifier: MIT
#pragma once
// A runner with everything around it faked: clock, lidar, stage, operator, and one session file.

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
#include <nlohmann/json.hpp>

#include "rig/runner/operators.hpp"
#include "rig/runner/runner.hpp"

namespace runner_rig {

/// Lets everything else that is ready run first.
inline boost::asio::awaitable<void> yield() {
  auto executor = co_await boost::asio::this_coro::executor;
  co_await boost::asio::post(executor, boost::asio::use_awaitable);
}

class FakeClock final : public rig::RunClock {
 public:
  std::int64_t now_us = 100'000'000;
  bool is_real = false;  ///< The computer's clocks.
  std::function<void(double seconds)> when_asleep = [](double) {};
  std::int64_t host_us() const override { return is_real ? real->host_us() : now_us; }
  std::int64_t unix_us() const override { return is_real ? real->unix_us() : 1'700'000'000'000'000 + now_us; }
  boost::asio::awaitable<void> sleep(double seconds) override {
    when_asleep(seconds);
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
  nlohmann::json parameters, information;
  rig::LidarStream stream;

  std::function<void()> when_connecting = [] {};
  boost::asio::awaitable<nlohmann::json> connect() override {
    ++connects;
    when_connecting();
    co_await yield();
    if (dead) throw rig::DeviceError("nothing listens at the lidar's address.");
    nlohmann::json who{{"version", {{"SERI", "H123"}}}};
    if (!parameters.empty()) who["PP"] = parameters;
    if (!information.empty()) who["II"] = information;
    co_return who;
  }
  /// What the scans' times are late by since the clocks were last compared: a crystal runs on.
  double drift_ppm = 0;
  std::int64_t compared_us = 0;
  boost::asio::awaitable<void> synchronise() override {
    co_await yield();
    if (dead) throw rig::DeviceError("the lidar is gone.");
    compared_us = bench_.clock.now_us;
  }
  boost::asio::awaitable<void> start(rig::LidarStream wanted) override {
    stream = wanted;
    co_await yield();
    if (dead) throw rig::DeviceError("the lidar is gone.");
  }
  boost::asio::awaitable<lidar::Scan> next() override {
    co_await yield();
    if (silent) {
      when_silent();
      boost::asio::steady_timer never(co_await boost::asio::this_coro::executor,
                                      boost::asio::steady_timer::time_point::max());
      boost::system::error_code ended;
      co_await never.async_wait(boost::asio::redirect_error(boost::asio::use_awaitable, ended));
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
  boost::asio::awaitable<void> stop() override {
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
  std::string serial;
  double readback_error_deg = 0;
  int loses_link_at_move = -1;  ///< Counted from 0.

  boost::asio::awaitable<rig::StageIdentity> identify() override {
    rig::StageIdentity who;
    who.language = "zaber", who.model = "test", who.serial = serial;
    co_return who;
  }
  bool loses_link_at_status = false;
  int failing_homings = 0;
  boost::asio::awaitable<rig::StageStatus> status() override {
    if (std::exchange(loses_link_at_status, false)) {
      homed = false;
      throw rig::StageLost("the stage does not answer.");
    }
    if (moving && rate_deg_s != 0)
      bench_.stage_deg =
          began_deg + turns_at * rate_deg_s * 1e-6 * static_cast<double>(bench_.clock.now_us - began_us);
    rig::StageStatus status;
    status.position_deg = bench_.stage_deg, status.homed = homed, status.moving = moving;
    co_return status;
  }
  boost::asio::awaitable<void> home() override {
    ++homings;
    if (failing_homings > 0) {
      --failing_homings;
      throw rig::StageError("homing ended with no reference found.");
    }
    homed = true;
    bench_.stage_deg = 0;
    co_await yield();
  }
  boost::asio::awaitable<double> move_to(double target_deg) override {
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
  double rate_deg_s = 0, began_deg = 0, turns_at = 1;  ///< A share of the commanded rate.
  int turns = 0;
  std::int64_t began_us = 0;
  boost::asio::awaitable<void> turn(double rate) override {
    ++turns;
    moving = true;
    began_deg = bench_.stage_deg, began_us = bench_.clock.now_us;
    rate_deg_s = rate;
    co_await yield();
  }
  boost::asio::awaitable<void> stop() override {
    ++stops;
    for (int i = 0; i < yields_at_stop; ++i) co_await yield();
    if (lost_for_good) throw rig::StageLost("the stage does not answer.");
    moving = false;
  }
  bool lost_for_good = false;
  int yields_at_stop = 1;
  std::function<bool()> is_plugged_in = [] { return true; };
  boost::asio::awaitable<void> reopen() override {
    ++reopens;
    co_await yield();
    if (!is_plugged_in()) throw rig::StageError("the stage's port is not there.");
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
  boost::asio::awaitable<rig::Answer> ask(rig::Prompt prompt) override {
    co_await yield();
    asked.push_back(prompt.title);
    if (silent) {
      boost::asio::steady_timer never(co_await boost::asio::this_coro::executor,
                                      boost::asio::steady_timer::time_point::max());
      co_await never.async_wait(boost::asio::use_awaitable);
    }
    co_return answers(prompt);
  }
  bool unattended() const override { return nobody; }
};

inline fit::Bench small_bench() {
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
  nlohmann::json fitted = {{"values", nlohmann::json::array()}};
  std::function<nlohmann::json(const std::string&, const rig::SessionStore&, const nlohmann::json&)> fit =
      [this](const std::string&, const rig::SessionStore&, const nlohmann::json&) { return fitted; };
  std::function<rig::RunnerParts::Written(const std::string&, const std::string&)> report =
      [](const std::string&, const std::string&) { return rig::RunnerParts::Written{}; };
  boost::asio::io_context io{1};
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
    rig::RunnerParts parts{lidar, stage, world.clock, person, fit, report, accepts_lidar, doubts_bench};
    rig::Runner runner(rig::parse_procedure(text, "test.yaml"), bench, session, parts);
    prepare(runner);
    std::exception_ptr why;
    bool met = false, ended = false;
    io.restart();
    boost::asio::co_spawn(io, runner.run(), [&](std::exception_ptr error, bool result) {
      why = error, met = result, ended = true;
    });
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
  int times_reported(const std::string& words) const {
    const rig::SessionStore session(file, rig::SessionStore::Mode::read);
    int times = 0;
    for (const auto& event : session.events()) times += event.text.find(words) != std::string::npos;
    return times;
  }
  bool reported(const std::string& words) const { return times_reported(words) > 0; }
};

}  // namespace runner_rig
