// SPDX-License-Identifier: MIT
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/experimental/awaitable_operators.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/asio/write.hpp>
#include <catch2/catch.hpp>

#include "tests/support/lidar_bench.hpp"

namespace lidar_client_test {

using Catch::Matchers::Contains;
namespace asio = boost::asio;
using asio::awaitable;
using namespace asio::experimental::awaitable_operators;

using lidar_bench::Bench;
using lidar_bench::kind_of_failure;

TEST_CASE("a lidar is identified, streams whole scans in order, and is silent after stop") {
  Bench bench;
  lidar::Client client = bench.client();
  std::vector<lidar::Scan> scans;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    for (int i = 0; i < 200; ++i) scans.push_back(co_await client.next());
    co_await client.stop();
    lidar::StreamRequest part(500, 580, 3, 1, false);
    co_await client.start(part);
    scans.push_back(co_await client.next());
    co_await client.stop();
  };
  bench.run(session);
  CHECK(client.identity().model == "UST-10LX");
  CHECK(client.identity().serial == "H2600001");
  CHECK(client.identity().max_step == 1080);
  REQUIRE(scans.size() == 201);
  for (std::size_t i = 1; i < 200; ++i) {
    REQUIRE(scans[i].device_ms > scans[i - 1].device_ms);
    REQUIRE(scans[i].range_mm.size() == 1081);
    REQUIRE(scans[i].intensity.size() == 1081);
  }
  CHECK(std::abs(scans[7].range_mm[540] - 1000) < 30);
  CHECK(scans[7].range_mm[0] == 0);  // nothing stands there: the code 65533 is no range
  CHECK(scans.back().range_mm.size() == 27);
  CHECK(scans.back().intensity.empty());
  CHECK(client.statistics().lost == 0);
  CHECK(client.statistics().bad == 0);
  CHECK_FALSE(bench.device.streaming());
}

TEST_CASE("at maximum speed, who lets a minute pass finds a minute passed and not hours") {
  Bench bench;
  lidar::Client client = bench.client();
  double passed_s = 0, after_s = 0;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest beam(540, 540, 1, 9, false);
    co_await client.start(beam);
    const lidar::Scan first = co_await client.next();
    while (passed_s < 60) {
      const lidar::Scan scan = co_await client.next();
      passed_s = static_cast<double>(scan.device_ms - first.device_ms) / 1e3;
    }
    co_await client.stop();
    co_await client.start(beam);
    const lidar::Scan scan = co_await client.next();
    after_s = static_cast<double>(scan.device_ms - first.device_ms) / 1e3;
    co_await client.stop();
  };
  bench.run(session);
  CHECK(passed_s < 61);
  CHECK(after_s < 300);  // It was hours: as much of the stream as the buffers on the way take.
}

TEST_CASE("a device that an earlier client left streaming is cleaned up, and its scans are not delivered") {
  Bench bench;
  // The abandoned stream comes over the same connection, as from a device that keeps it: the first bytes are
  // scans.
  bool first = true;
  std::string left_over;
  sim::ScipServer::Fault fault;
  fault.to_host = [&](std::string bytes, bool&) {
    if (!std::exchange(first, false)) return bytes;
    return "ME0000108001000\n99b\nHalf a scan\n\nME0000108001" + bytes;
  };
  bench.server.set_fault(fault);
  lidar::Client client = bench.client();
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    const lidar::Scan scan = co_await client.next();
    CHECK(scan.range_mm.size() == 1081);
    co_await client.stop();
  };
  bench.run(session);
  CHECK(client.statistics().bad == 0);
}

TEST_CASE("damaged scans are dropped and counted, and the stream goes on") {
  Bench bench;
  int scans_sent = 0;
  sim::ScipServer::Fault fault;
  fault.to_host = [&](std::string bytes, bool&) {
    if (bytes.size() < 60000) return bytes;
    if (++scans_sent % 3 == 1) bytes[1000] = static_cast<char>(bytes[1000] ^ 1);
    if (scans_sent % 3 == 2) bytes.erase(7000, 10);
    return bytes;
  };
  bench.server.set_fault(fault);
  lidar::Client client = bench.client();
  std::vector<lidar::Scan> scans;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    for (int i = 0; i < 300; ++i) scans.push_back(co_await client.next());
    co_await client.stop();
  };
  bench.run(session);
  CHECK(client.statistics().bad > 10);
  // Damage before the first delivered scan or after the last leaves no gap between two.
  CHECK(client.statistics().lost + 1 >= client.statistics().bad);
  CHECK(client.statistics().lost <= client.statistics().bad);
  for (const lidar::Scan& scan : scans) REQUIRE(std::abs(scan.range_mm[540] - 1000) < 30);
}

TEST_CASE("a lost connection is reported, and reconnecting goes on with the same lidar") {
  Bench bench;
  lidar::Client client = bench.client();
  std::string message;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    co_await client.next();
    bench.server.drop_connection();
    std::optional<lidar::LidarError> lost;
    try {
      while (true) co_await client.next();
    } catch (const lidar::LidarError& error) {
      lost = error;
    }
    REQUIRE(lost);
    CHECK(lost->kind() == lidar::LidarError::Kind::connection_lost);
    CHECK_FALSE(client.connected());
    co_await client.reconnect();
    co_await client.start(all);
    const lidar::Scan scan = co_await client.next();
    CHECK(scan.range_mm.size() == 1081);
    co_await client.stop();
  };
  bench.run(session);
  CHECK(client.statistics().reconnects == 1);
}

TEST_CASE("a lidar that falls silent is reported within the limit") {
  Bench bench;
  bool silent = false;
  sim::ScipServer::Fault fault;
  fault.to_host = [&](std::string bytes, bool&) { return silent ? std::string() : bytes; };
  bench.server.set_fault(fault);
  lidar::Options options;
  options.scan_timeout = std::chrono::milliseconds(100);
  options.reply_timeout = std::chrono::milliseconds(50);
  options.stop_timeout = std::chrono::milliseconds(200);
  lidar::Client client = bench.client(options);
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    co_await client.next();
    silent = true;
    while (true) co_await client.next();
  };
  std::string what;
  CHECK(kind_of_failure([&] { bench.run(session); }, &what) == lidar::LidarError::Kind::no_answer);
  CHECK_THAT(what, Contains("no scan for 100 ms"));
}

TEST_CASE("nothing at the address is reported with what to check") {
  Bench bench;
  const std::uint16_t port = bench.server.port();
  bench.server.stop();
  lidar::Client client(bench.io.get_executor(), "127.0.0.1", port);
  auto session = [&]() -> awaitable<void> { co_await client.connect(); };
  std::string what;
  CHECK(kind_of_failure([&] { bench.run(session); }, &what) == lidar::LidarError::Kind::cannot_connect);
  CHECK_THAT(what, Contains("nothing listens at 127.0.0.1:" + std::to_string(port)) &&
                       Contains("Check that this is the lidar's address and port"));
}

TEST_CASE("something that listens and says nothing is no lidar") {
  asio::io_context io{1};
  asio::ip::tcp::acceptor mute(io, {asio::ip::make_address("127.0.0.1"), 0});
  lidar::Options options;
  options.reply_timeout = std::chrono::milliseconds(30);
  options.stop_timeout = std::chrono::milliseconds(100);
  lidar::Client client(io.get_executor(), "127.0.0.1", mute.local_endpoint().port(), options);
  std::exception_ptr why;
  asio::co_spawn(io, client.connect(),
                 [&](std::exception_ptr failed, const lidar::Identity&) { why = failed; });
  io.run_for(std::chrono::seconds(10));
  REQUIRE(why);
  CHECK(kind_of_failure([&] { std::rethrow_exception(why); }) == lidar::LidarError::Kind::not_a_lidar);
}

TEST_CASE("cancelling a stream ends it on the device") {
  Bench bench(1);
  lidar::Client client = bench.client();
  auto measure = [&]() -> awaitable<void> {
    lidar::StreamRequest all;
    co_await client.start(all);
    while (true) co_await client.next();
  };
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    asio::steady_timer enough(bench.io, std::chrono::milliseconds(80));
    co_await (measure() || enough.async_wait(asio::use_awaitable));
    CHECK_FALSE(bench.device.streaming());
    CHECK(client.connected());
  };
  bench.run(session);
  CHECK(client.statistics().scans >= 1);
}

TEST_CASE("clocks are related to well below the stamp's millisecond, wherever the timer starts") {
  Bench bench(1);
  lidar::Client client = bench.client();
  double error_us = 1e9;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    const lidar::ClockEstimate estimate = co_await client.synchronise();
    CHECK(estimate.synchronised);
    CHECK(estimate.follows_host);
    const double truth_us = [&] {
      // The simulated timer is fast by clock_ppm and began with the simulated clock.
      const double at_s = estimate.device_ms / 1000 / (1 + 50e-6);
      return static_cast<double>(
          std::chrono::duration_cast<std::chrono::microseconds>(bench.clock.when(at_s).time_since_epoch())
              .count());
    }();
    error_us = estimate.host_us - truth_us;
    CHECK(std::abs(error_us) < 4 * estimate.offset_u_us + 20);
    CHECK(estimate.offset_u_us < 150);
  };
  bench.run(session);
  INFO(error_us);
}

}  // namespace lidar_client_test
