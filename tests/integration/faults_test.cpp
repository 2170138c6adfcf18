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

namespace faults_test {

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
          co_await client->connect();
        }
        if (!client->streaming()) {
          co_await client->start(all);
        }
        const lidar::Scan scan = co_await client->next();
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
        co_await client->stop();
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

/// The fault over within 0.05 s, if it is one that lasts.
std::string quick(const std::string& name) {
  std::istringstream in(sim::FaultInjector::catalogue());
  for (std::string line; std::getline(in, line);)
    if (line.starts_with(name + " ") && line.find(" s=") != std::string::npos) return name + " s=0.05";
  return name;
}

}  // namespace

TEST_CASE("after every single fault of the catalogue scans are right and the stage is where it says") {
  FaultyBench bench;
  for (const std::string& name : fault_names()) {
    INFO(name);
    // Nobody can notice lost steps without an encoder; the fault that simulates them is tested elsewhere.
    if (name == "stage lose-position") continue;
    bench.run(bench.take_scans(2));
    bench.faults->add(quick(name));
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
  std::size_t faults = 0;
  for (const std::string& name : fault_names()) {
    INFO(language << ": " << name);
    if (!name.starts_with("stage") || name == "stage lose-position") continue;
    bench.faults->add(quick(name));
    ++faults;
    target_deg = target_deg > 5 ? -5 : target_deg + 1;
    bench.run(bench.reach(target_deg));
  }
  CHECK(faults > 5);
  CHECK(bench.faults->count() == faults);
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
  CHECK(bench.faults->count() == 11);
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

namespace {

/// A driver on a faulty bench, impatient, and what it says when it fails.
struct Watched : FaultyBench {
  template <class Make>
  std::string failure(Make make) {
    try {
      run(make());
    } catch (const lidar::LidarError& error) {
      kind = error.kind();
      return error.what();
    }
    return "nothing failed";
  }
  awaitable<void> stream(int scans) {
    const lidar::StreamRequest all;
    if (!client->connected()) co_await client->connect();
    if (!client->streaming()) co_await client->start(all);
    for (int i = 0; i < scans; ++i) {
      const lidar::Scan scan = co_await client->next();
      if (last_ms && scan.device_ms <= *last_ms) throw std::runtime_error("a scan came twice");
      last_ms = scan.device_ms;
    }
  }
  std::optional<std::uint64_t> last_ms;
  std::optional<lidar::LidarError::Kind> kind;
};

using Kind = lidar::LidarError::Kind;

}  // namespace

TEST_CASE("a scan that comes twice, or with a stamp of before, is delivered once and counted") {
  Watched bench;
  bench.run(bench.stream(5));
  bench.faults->add("lidar repeat-scan times=3");
  bench.run(bench.stream(100));
  CHECK(bench.client->statistics().repeated == 3);
  bench.faults->add("lidar old-stamp ms=60");
  bench.run(bench.stream(100));
  CHECK(bench.client->statistics().repeated == 4);
  CHECK(bench.client->statistics().scans == 205);
  CHECK(bench.client->statistics().bad == 0);
}

TEST_CASE("a lidar whose timer stands is reported as that, and none of those scans is delivered") {
  Watched bench;
  bench.run(bench.stream(5));
  bench.faults->add("lidar clock-stands s=2");
  CHECK_THAT(bench.failure([&] { return bench.stream(400); }), Contains("do not advance"));
  CHECK(bench.kind == Kind::bad_answer);
}

TEST_CASE("scans with too few values or a short line are counted and cost nothing else") {
  Watched bench;
  bench.run(bench.stream(5));
  for (const char* name : {"lidar short-scan", "lidar short-line", "lidar insert", "lidar checksum"}) {
    INFO(name);
    const auto before = bench.client->statistics();
    bench.faults->add(name);
    bench.run(bench.stream(100));
    CHECK(bench.client->statistics().bad - before.bad >= 1);
    CHECK(bench.client->statistics().bad - before.bad <= 2);
    CHECK(bench.client->statistics().lost - before.lost == 1);
  }
}

TEST_CASE("a stream that stops without a word says what the lidar says of itself") {
  Watched bench;
  bench.run(bench.stream(5));
  SECTION("the laser went off by itself") {
    bench.faults->add("lidar laser-off");
    CHECK_THAT(bench.failure([&] { return bench.stream(200); }),
               Contains("sent no scan") && Contains("laser OFF") && Contains("Idle"));
  }
  SECTION("it believes that it measures") {
    bench.faults->add("lidar stall");
    CHECK_THAT(bench.failure([&] { return bench.stream(200); }),
               Contains("sent no scan") && Contains("laser ON") && Contains("Measuring"));
  }
  SECTION("it answers nothing any more") {
    bench.faults->add("lidar stall");
    bench.faults->add("lidar deaf");
    CHECK_THAT(bench.failure([&] { return bench.stream(200); }), Contains("does not answer queries either"));
  }
  CHECK(bench.kind == Kind::no_answer);
  bench.run(bench.take_scans(10));
}

TEST_CASE("a lidar that checks itself and goes on is waited for") {
  Watched bench;
  bench.run(bench.stream(5));
  bench.faults->add("lidar self-check code=34 s=0.4");
  bench.run(bench.stream(200));
  CHECK(bench.client->statistics().lost >= 14);
  CHECK(bench.client->statistics().lost <= 18);
  CHECK(bench.client->statistics().reconnects == 0);
}

TEST_CASE("a stream of another kind than was asked for is reported as that, and the next is right") {
  Watched bench;
  bench.faults->add("lidar wrong-mode");
  CHECK_THAT(bench.failure([&] { return bench.stream(10); }),
             Contains("MD00001080") && Contains("not asked for"));
  bench.run(bench.take_scans(10));
}

TEST_CASE("a lidar that heeds neither questions nor QT is reset when it is connected") {
  Watched bench;
  bench.run(bench.stream(5));
  bench.faults->add("lidar deaf reset=1");
  bench.client->close();
  bench.last_ms.reset();
  bench.run(bench.stream(10));
}

TEST_CASE("damage that ends with the connection is survived by connecting once more") {
  Watched bench;
  bench.faults->add("lidar bad-connection");
  bench.run(bench.stream(10));
  CHECK(bench.client->statistics().failed_connects == 1);
  CHECK(bench.client->statistics().bad >= 3);
}

TEST_CASE("a refusal that passes is waited for; one that stays is reported with how often it was asked") {
  Watched bench;
  bench.run(bench.stream(1));
  bench.faults->add("lidar refuse-time s=0.1");
  const auto compare = [&]() -> awaitable<void> { co_await bench.client->synchronise(); };
  bench.run(compare());
  bench.faults->add("lidar refuse-time s=30");
  CHECK_THAT(bench.failure(compare), Contains("TM0") && Contains("status 10") && Contains("asked 3 times"));
  CHECK(bench.kind == Kind::refused);
}

TEST_CASE("parameters without which beams have no direction are not made up") {
  Watched bench;
  bench.faults->add("lidar missing-parameter line=6");
  bench.run(bench.stream(5));  // the second answer has them
  bench.client->close();
  bench.last_ms.reset();
  bench.faults->add("lidar missing-parameter line=4");
  bench.faults->add("lidar missing-parameter line=6");  // the same answer lacks two
  CHECK(bench.client->statistics().failed_connects == 1);
  bench.run(bench.stream(5));
}

TEST_CASE("another lidar at the address is refused however often it is tried, and the first one taken back") {
  Watched bench;
  bench.run(bench.stream(5));
  bench.lidar_device.change_serial("H2699999");
  const auto reconnect = [&]() -> awaitable<void> { co_await bench.client->reconnect(); };
  for (int i = 0; i < 3; ++i) {
    CHECK_THAT(bench.failure(reconnect), Contains("H2699999") && Contains("H2600001"));
    CHECK(bench.kind == Kind::refused);
  }
  bench.lidar_device.change_serial("H2600001");
  bench.run(reconnect());
  CHECK(bench.client->identity().serial == "H2600001");
}

TEST_CASE("statistics go on across reconnections, and a failure says where and how often it was tried") {
  Watched bench;
  bench.run(bench.stream(30));
  const std::uint64_t before = bench.client->statistics().scans;
  CHECK(before == 30);
  bench.server.refuse_connections(0.3);
  bench.client->close();
  const auto reconnect = [&]() -> awaitable<void> { co_await bench.client->reconnect(); };
  const std::string address = "127.0.0.1:" + std::to_string(bench.server.port());
  CHECK_THAT(bench.failure(reconnect), Contains(address) && !Contains("Tried"));
  CHECK_THAT(bench.failure(reconnect), Contains(address) && Contains("Tried 2 times"));
  CHECK(bench.kind == Kind::cannot_connect);
  while (bench.failure(reconnect) != "nothing failed") bench.run(bench.pause());
  bench.run(bench.stream(20));
  CHECK(bench.client->statistics().scans == 50);
  CHECK(bench.client->statistics().reconnects == 1);
  CHECK(bench.client->statistics().failed_connects >= 2);
}

}  // namespace faults_test
