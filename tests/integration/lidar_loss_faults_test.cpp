// SPDX-License-Identifier: MIT
// What goes wrong between a lidar and its driver, over real sockets: each ends in recovery or in an error
// that names the fault, within its deadline. Connections that are lost, and lidars that come back.
#include <catch2/catch.hpp>

#include "lidar/encoding.hpp"
#include "lidar/response.hpp"
#include "tests/support/faulty_lidar.hpp"

namespace lidar_loss_faults_test {

using Catch::Matchers::Contains;
using namespace faulty_lidar;

TEST_CASE("a half-open connection ends in an error, and reconnecting in a stream") {
  Bench bench;
  bool cut = false;
  sim::ScipServer::Fault fault;
  fault.to_host = [&](std::string bytes, bool&) { return cut ? std::string() : bytes; };
  fault.to_device = [&](std::string bytes) { return cut ? std::string() : bytes; };
  bench.server.set_fault(fault);
  lidar::Client client = bench.client(impatient());
  std::uint64_t last_before = 0;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    last_before = (co_await client.next()).device_ms;
    cut = true;
    std::optional<lidar::LidarError> reported;
    const auto begun = steady_clock::now();
    try {
      while (true) last_before = (co_await client.next()).device_ms;
    } catch (const lidar::LidarError& error) {
      reported = error;
    }
    REQUIRE(reported);
    CHECK(reported->kind() == Kind::no_answer);
    CHECK(steady_clock::now() - begun < deadline);
    cut = false;
    co_await client.reconnect();
    co_await client.start(all);
    const lidar::Scan scan = co_await client.next();
    CHECK(scan.device_ms > last_before);
  };
  bench.run(session);
  CHECK(client.statistics().reconnects == 1);
}

TEST_CASE("a reset by the network is reported as a lost connection") {
  sim::UstDevice device = lidar_bench::device();
  Listener listener([&](tcp::socket& socket) -> awaitable<void> {
    const std::string line = co_await answer_until(socket, device, "ME");
    co_await write(socket, device.handle(line, 1));
    socket.set_option(asio::socket_base::linger(true, 0));  // close() sends RST
    socket.close();
  });
  lidar::Client client = listener.client(impatient());
  std::string what;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    while (true) co_await client.next();
  };
  CHECK(kind_of_failure([&] { listener.run(session); }, &what) == Kind::connection_lost);
  CHECK_THAT(what, Contains("power and network cable"));
  CHECK_FALSE(client.connected());
}

TEST_CASE("a lidar that refuses QT is not taken for one whose laser is off") {
  sim::UstDevice device = lidar_bench::device();
  const bool streams_on = GENERATE(true, false);
  Listener listener([&](tcp::socket& socket) -> awaitable<void> {
    const std::string line = co_await answer_until(socket, device, "ME");
    co_await write(socket, device.handle(line, 1));
    bool goes_on = true;
    while (goes_on) {
      const std::string quit = co_await answer_until(socket, device, "QT");
      std::string answer = lidar::build_status_response(quit, "10");
      for (int i = 0; streams_on && i < 3; ++i) device.append_next_scan(answer);
      goes_on = !quit.empty() && co_await write(socket, answer);
    }
  });
  lidar::Client client = listener.client(impatient());
  std::string what;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    const lidar::StreamRequest all;
    co_await client.start(all);
    co_await client.stop();
  };
  CHECK(kind_of_failure([&] { listener.run(session); }, &what) == Kind::refused);
  CHECK_THAT(what, Contains("laser may be on") && Contains("status 10"));
}

TEST_CASE("a lidar whose stamps stand still is said to do that, on every connection, and not to restart") {
  Bench bench;
  std::string stamp;
  faulty_lidar::set_fault(bench, [&](std::string message) {
    const std::size_t begin = message.find("99b\n") + 4, end = message.find('\n', begin);
    if (stamp.empty()) stamp = message.substr(begin, end - begin);
    return message.replace(begin, end - begin, stamp);
  });
  lidar::Client client = bench.client(impatient());
  std::vector<std::string> reported;
  auto session = [&]() -> awaitable<void> {
    const lidar::StreamRequest all;
    co_await client.connect();
    for (int connection = 0; connection < 3; ++connection) {
      if (connection > 0) co_await client.reconnect();
      co_await client.synchronise();
      co_await client.start(all);
      try {
        while (true) co_await client.next();
      } catch (const lidar::LidarError& error) {
        reported.push_back(error.what());
      }
    }
  };
  bench.run(session);
  REQUIRE(reported.size() == 3);
  for (const std::string& what : reported) CHECK_THAT(what, Contains("do not advance"));
  CHECK(client.clock().resets == 0);
  CHECK(client.statistics().scans == 1);
}

TEST_CASE("a device that streams to whoever connects, and ignores the first QT, is brought to rest") {
  sim::UstDevice device = lidar_bench::device();
  int ignored = 0;
  bool streams = true;
  Listener listener([&](tcp::socket& socket) -> awaitable<void> {
    const std::string start = device.handle("ME0000108000000", 0);
    (void)start;
    double now_s = 0;
    asio::streambuf buffer;
    while (true) {
      if (streams) {  // one scan between any two lines that the host sends
        std::string scan;
        now_s = device.next_scan_ready_s(now_s);
        device.append_next_scan(scan);
        auto writing = write(socket, std::move(scan));
        if (!co_await std::move(writing)) co_return;
      }
      const auto [failed, n] =
          co_await asio::async_read_until(socket, buffer, '\n', asio::as_tuple(asio::use_awaitable));
      if (failed) co_return;
      const std::string line(asio::buffers_begin(buffer.data()),
                             asio::buffers_begin(buffer.data()) + static_cast<std::ptrdiff_t>(n - 1));
      buffer.consume(n);
      if (line.starts_with("QT") && ++ignored == 1) continue;
      const std::string reply = device.handle(line, now_s);
      streams = device.streaming();
      auto writing = write(socket, reply);
      if (!co_await std::move(writing)) co_return;
    }
  });
  lidar::Client client = listener.client(impatient());
  auto session = [&]() -> awaitable<void> { co_await client.connect(); };
  listener.run(session);
  CHECK(client.connected());
  CHECK(client.identity().serial == "H2600001");
  CHECK(client.statistics().bad == 0);
  CHECK(ignored >= 2);
}

TEST_CASE("a lidar that reboots in a stream is found again, and its time goes on") {
  Bench bench;
  lidar::Client client = bench.client(impatient());
  std::uint64_t last_before = 0;
  std::int64_t last_host = 0;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    for (int i = 0; i < 400; ++i) {
      const lidar::Scan scan = co_await client.next();
      last_before = scan.device_ms;
      last_host = scan.host_us;
    }
    bench.device.reboot(bench.clock.now_s());
    bench.server.drop_connection();
    std::optional<lidar::LidarError> reported;
    try {
      while (true) {
        const lidar::Scan scan = co_await client.next();
        last_before = scan.device_ms;
        last_host = scan.host_us;
      }
    } catch (const lidar::LidarError& error) {
      reported = error;
    }
    REQUIRE(reported);
    CHECK(reported->kind() == Kind::connection_lost);
    co_await client.reconnect();
    co_await client.start(all);
    for (int i = 0; i < 50; ++i) {
      const lidar::Scan scan = co_await client.next();
      REQUIRE(scan.device_ms > last_before);
      REQUIRE(scan.host_us > last_host);
      last_before = scan.device_ms;
      last_host = scan.host_us;
    }
  };
  bench.run(session);
  CHECK(client.clock().resets == 1);
}

TEST_CASE("the 24-bit wrap of the timer passes in a stream without loss") {
  sim::UstIdentity identity;
  identity.clock_start_ms = 0x1000000 - 1000;
  Bench bench(sim::SimClock::max_speed, identity);
  lidar::Client client = bench.client();
  std::uint64_t last = 0;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest part(500, 520);
    co_await client.start(part);
    for (int i = 0; i < 200; ++i) {
      const lidar::Scan scan = co_await client.next();
      if (i > 0) REQUIRE(scan.device_ms - last <= 26);
      last = scan.device_ms;
    }
  };
  bench.run(session);
  CHECK(last > 0x1000000);
  CHECK(client.statistics().lost == 0);
  CHECK(client.clock().resets == 0);
}

TEST_CASE("another lidar in the first one's place is refused after reconnecting") {
  Bench bench;
  bool other = false;
  sim::ScipServer::Fault fault;
  fault.to_host = [&](std::string bytes, bool&) {
    const std::size_t at = bytes.find("SERI:H2600001;");
    if (!other || at == std::string::npos) return bytes;
    const std::string line = "SERI:H2600002";
    return bytes.replace(at, line.size() + 2, line + ";" + lidar::checksum(line));
  };
  bench.server.set_fault(fault);
  lidar::Client client = bench.client(impatient());
  std::string what;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    other = true;
    bench.server.drop_connection();
    co_await client.reconnect();
  };
  CHECK(kind_of_failure([&] { bench.run(session); }, &what) == Kind::refused);
  CHECK_THAT(what, Contains("H2600002") && Contains("H2600001"));
}

TEST_CASE("a lidar that refuses to measure is reported with its reason") {
  Bench bench;
  sim::ScipServer::Fault fault;
  fault.to_host = [](std::string bytes, bool&) {
    const bool to_measure = bytes.find("ME") == 0;
    return to_measure ? lidar::build_status_response(bytes.substr(0, bytes.find('\n')), "0L") : bytes;
  };
  bench.server.set_fault(fault);
  lidar::Client client = bench.client(impatient());
  std::string what;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
  };
  CHECK(kind_of_failure([&] { bench.run(session); }, &what) == Kind::hardware_fault);
  CHECK_THAT(what, Contains("0L") && Contains("error state"));
  CHECK_FALSE(client.streaming());
}

}  // namespace lidar_loss_faults_test
