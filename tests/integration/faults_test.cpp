// SPDX-License-Identifier: MIT
#include "sim/faults.hpp"

#include <unistd.h>

#include <algorithm>
#include <boost/asio/steady_timer.hpp>
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "lidar/client.hpp"
#include "rig/errors.hpp"
#include "sim/scip_server.hpp"
#include "sim/simple_engine.hpp"
#include "tests/support/stage_rig.hpp"

using boost::asio::awaitable;
using Catch::Matchers::Contains;

namespace {

fit::Bench wall_bench() {
  return fit::parse_bench(R"({"schema": "bench/1", "lidar": {"model": "UST-10LX"}, "stage": {},
    "targets": [{"name": "wall", "from_mm": [1000, -3000], "to_mm": [1000, 3000]}], "known": []})");
}

/// Both devices with faults, both drivers, and a controller that does what a runner does after each failure.
struct FaultyBench : StageRig {
  explicit FaultyBench(std::uint64_t seed = 1, const std::string& language = "zaber")
      : StageRig(language, sim::SimClock::max_speed, true),
        zero_deg(sim::usual_stage_zero_deg(language)),
        bench(wall_bench()),
        engine(std::make_shared<sim::SimpleEngine>(bench, sim::simple_options(bench), seed)),
        lidar_device(bench.lidar, sim::UstIdentity(), engine,
                     [this](double time_s) { return device->mechanics().truth(time_s); }),
        server(io.get_executor(), sim::ScipServer::Options(), clock, lidar_device) {
    port_options.link =
        (std::filesystem::temp_directory_path() / ("faulty_" + std::to_string(::getpid()))).string();
    options.reply_s = 0.1;
    open();
    sim::FaultInjector::Bench faulty;
    faulty.server = &server;
    faulty.lidar = &lidar_device;
    faulty.port = port.get();
    faulty.stage = device.get();
    faults = std::make_unique<sim::FaultInjector>(io.get_executor(), clock, faulty, seed);
    lidar::Options lidar_options;
    lidar_options.reply_timeout = std::chrono::milliseconds(200);
    lidar_options.scan_timeout = std::chrono::milliseconds(400);
    lidar_options.stop_timeout = std::chrono::milliseconds(1000);
    client = std::make_unique<lidar::Client>(io.get_executor(), "127.0.0.1", server.port(), lidar_options);
  }
  ~FaultyBench() {
    faults.reset();
    server.stop();
  }

  awaitable<void> pause() {
    boost::asio::steady_timer timer(io, std::chrono::milliseconds(10));
    co_await timer.async_wait(boost::asio::use_awaitable);
  }

  /// Good scans, whatever happens on the way.
  awaitable<void> take_scans(int count) {
    const lidar::StreamRequest all;
    int failures = 0;
    while (count > 0) {
      bool failed = false;
      try {
        if (!client->connected()) {
          auto connecting = client->connect();
          co_await std::move(connecting);
        }
        if (!client->streaming()) {
          auto starting = client->start(all);
          co_await std::move(starting);
        }
        auto receiving = client->next();
        const lidar::Scan scan = co_await std::move(receiving);
        if (scan.range_mm.at(540) < 900 || scan.range_mm.at(540) > 1100)
          throw std::runtime_error("a false scan");
        --count;
      } catch (const lidar::LidarError&) {
        failed = true;
      }
      if (!failed) continue;
      client->close();
      if (++failures > 30) throw std::runtime_error("the lidar never came back");
      co_await pause();
    }
    if (client->streaming()) {
      try {
        auto stopping = client->stop();
        co_await std::move(stopping);
      } catch (const lidar::LidarError&) {
        client->close();
      }
    }
  }

  awaitable<void> reach(double target_deg) {
    for (int failures = 0; failures < 200; ++failures) {
      bool lost = false;
      try {
        const rig::StageStatus status = co_await stage->status();
        if (!status.homed) co_await stage->home();
        const double angle = co_await stage->move_to(target_deg);
        if (std::abs(angle - target_deg) > 1e-3) throw std::runtime_error("a false angle");
        if (std::abs(true_deg() - zero_deg - target_deg) > 1e-3)
          throw std::runtime_error("not where it says");
        co_return;
      } catch (const rig::StageLost&) {
        lost = true;
      } catch (const rig::StageError&) {
      }
      if (!lost) continue;
      co_await pause();
      try {
        co_await stage->reopen();
      } catch (const rig::StageError&) {
      }
    }
    throw std::runtime_error("the stage never came back");
  }

  double zero_deg;
  fit::Bench bench;
  std::shared_ptr<sim::SimpleEngine> engine;
  sim::UstDevice lidar_device;
  sim::ScipServer server;
  std::unique_ptr<sim::FaultInjector> faults;
  std::unique_ptr<lidar::Client> client;
};

std::vector<std::string> fault_names() {
  std::istringstream in(sim::FaultInjector::catalogue());
  std::vector<std::string> names;
  for (std::string line, device, fault; std::getline(in, line);) {
    std::istringstream words(line);
    words >> device >> fault;
    names.push_back(device + " " + fault);
  }
  return names;
}

}  // namespace

TEST_CASE("after every single fault of the catalogue scans are right and the stage is where it says") {
  FaultyBench bench;
  for (const std::string& name : fault_names()) {
    INFO(name);
    // Nobody can notice lost steps without an encoder; the fault that simulates them is tested elsewhere.
    if (name == "stage lose-position") continue;
    bench.run(bench.take_scans(2));
    const std::string quickly = name == "stage unplug" || name == "stage dead" ? " s=0.05" : "";
    bench.faults->add(name + quickly);
    if (name.starts_with("lidar")) bench.run(bench.take_scans(30));
    static double target_deg = 0;
    target_deg = target_deg > 5 ? -5 : target_deg + 1;
    if (name.starts_with("stage")) bench.run(bench.reach(target_deg));
  }
  CHECK(bench.faults->count() == fault_names().size() - 1);
}

TEST_CASE("stages without checksums are where they say as well, after every fault of theirs") {
  const std::string language = GENERATE("shot", "gsc", "falcon");
  FaultyBench bench(1, language);
  double target_deg = 0;
  for (const std::string& name : fault_names()) {
    INFO(language << ": " << name);
    if (!name.starts_with("stage") || name == "stage lose-position") continue;
    bench.faults->add(name + (name == "stage unplug" || name == "stage dead" ? " s=0.05" : ""));
    target_deg = target_deg > 5 ? -5 : target_deg + 1;
    bench.run(bench.reach(target_deg));
  }
}

TEST_CASE("a fault in the middle of a stream or of a move is survived as well") {
  FaultyBench bench;
  for (const char* name :
       {"lidar reset", "lidar half-open", "lidar reboot", "lidar status", "lidar lose", "lidar clock-wrap"}) {
    INFO(name);
    bench.faults->add("at=" + std::to_string(bench.clock.now_s() + 0.2) + " " + name);
    bench.run(bench.take_scans(40));
  }
  double target_deg = 30;
  for (const char* name :
       {"stage stall", "stage limit", "stage power-cycle", "stage unplug s=0.02", "stage lose-reply"}) {
    INFO(name);
    bench.faults->add("at=" + std::to_string(bench.clock.now_s() + 0.2) + " " + name);
    bench.run(bench.reach(target_deg = -target_deg));
  }
}

TEST_CASE("random faults are the same with the same seed, and happen at their rate") {
  const auto happened = [](std::uint64_t seed) {
    boost::asio::io_context io;
    sim::SimClock clock(sim::SimClock::max_speed);
    sim::StageDeviceOptions options;
    const auto device = sim::make_stage_device(options);
    sim::PtyPort port(io.get_executor(), *device, clock);
    sim::FaultInjector::Bench bench;
    bench.port = &port;
    bench.stage = device.get();
    sim::FaultInjector faults(io.get_executor(), clock, bench, seed);
    faults.add("random rate=0.5 stage");
    std::string text;
    for (int i = 0; i < 1000; ++i) {
      clock.advance_to(i);
      faults.add("at=0 stage split");
    }
    for (const sim::FaultEvent& event : faults.events())
      if (event.text != "stage split") text += event.text + "\n";
    return text;
  };
  const std::string first = happened(3);
  const auto lines = std::count(first.begin(), first.end(), '\n');
  CHECK(lines > 400);
  CHECK(lines < 550);
  CHECK(first == happened(3));
  CHECK(first != happened(4));
}

TEST_CASE("hundreds of random faults on both devices lose no scan silently and move the stage nowhere else") {
  FaultyBench bench(7);
  bench.faults->add("random rate=1 lidar lose");
  bench.faults->add("random rate=1 lidar flip");
  bench.faults->add("random rate=1 lidar checksum");
  bench.faults->add("random rate=0.2 lidar reset");
  bench.faults->add("random rate=0.1 lidar reboot");
  bench.faults->add("random rate=0.5 stage lose-reply");
  bench.faults->add("random rate=0.5 stage flip");
  bench.faults->add("random rate=0.5 stage garble-command");
  bench.faults->add("random rate=0.1 stage alert-storm");
  bench.faults->add("random rate=0.1 stage stall");
  for (int i = 0; i < 20; ++i) {
    bench.run(bench.reach(i % 7));
    bench.run(bench.take_scans(50));
  }
  CHECK(bench.faults->count() > 50);
}

TEST_CASE("a fault that there is not is refused with what there is") {
  FaultyBench bench;
  CHECK_THROWS_WITH(bench.faults->add("lidar explode"), Contains("lidar explode") && Contains("lidar reset"));
  CHECK_THROWS_WITH(bench.faults->add("at=soon lidar reset"), Contains("at=soon"));
  CHECK_THROWS_WITH(bench.faults->add("lidar reset bytes=3"), Contains("bytes=3"));
  CHECK_THROWS_WITH(bench.faults->add("random stage"), Contains("rate"));
  CHECK_THROWS_WITH(bench.faults->add("random rate=1 table"), Contains("table"));
  CHECK_THROWS_WITH(bench.faults->add("random rate=-1"), Contains("rate=-1"));
  CHECK_THROWS(bench.faults->add(""));
  CHECK_THROWS_WITH(bench.faults->add_file("/no/such/file"), Contains("/no/such/file"));
  const std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("faults_" + std::to_string(::getpid()));
  std::ofstream(path) << "# nothing\n\nat=1e6 lidar reset # late\nstage explode\n";
  CHECK_THROWS_WITH(bench.faults->add_file(path.string()), Contains(":4:"));
  std::filesystem::remove(path);
}
