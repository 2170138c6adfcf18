// SPDX-License-Identifier: MIT
// What goes wrong between a lidar and its driver, over real sockets: each ends in recovery or in an error
// that names the fault, within its deadline. Streams.
#include <catch2/catch.hpp>
#include <random>

#include "lidar/response.hpp"
#include "tests/support/faulty_lidar.hpp"

namespace lidar_stream_faults_test {

using Catch::Matchers::Contains;
using namespace faulty_lidar;

TEST_CASE("scans that were lost on the way are counted, each one") {
  Bench bench;
  int seen = 0, dropped = 0;
  set_fault(bench, [&](std::string message) {
    const bool drop = ++seen % 7 == 0 || seen % 50 > 45;
    dropped += drop;
    return drop ? std::string() : message;
  });
  lidar::Client client = bench.client();
  std::vector<std::uint64_t> stamps;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest part(500, 560);
    co_await client.start(part);
    for (int i = 0; i < 500; ++i) {
      const lidar::Scan scan = co_await client.next();
      stamps.push_back(scan.device_ms);
    }
  };
  bench.run(session);
  const auto spanned = std::llround(static_cast<double>(stamps.back() - stamps.front()) / 25.0) + 1;
  CHECK(client.statistics().lost == static_cast<std::uint64_t>(spanned - 500));
  CHECK(client.statistics().lost > 50);
  CHECK(static_cast<int>(client.statistics().lost) <= dropped);
}

TEST_CASE("no scan with a wrong checksum is delivered, and each is counted") {
  Bench bench;
  std::minstd_rand random(7);
  int damaged = 0, sent = 0;
  set_fault(bench, [&](std::string message) {
    if (++sent % 2 == 0) return message;
    ++damaged;
    const std::size_t begin = message.find("\n99b\n") + 5;  // the stamp and the values
    const std::size_t at = begin + random() % (message.size() - 2 - begin);
    if (message[at] != '\n')
      message[at] = static_cast<char>(message[at] ^ (1 << random() % 6));
    else
      message[at] = '0';
    return message;
  });
  lidar::Client client = bench.client();
  std::uint64_t last_ms = 0;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest part(530, 550);
    co_await client.start(part);
    for (int i = 0; i < 300; ++i) {
      const lidar::Scan scan = co_await client.next();
      if (i > 0) REQUIRE(scan.device_ms - last_ms >= 24);
      last_ms = scan.device_ms;
      for (const auto mm : scan.range_mm) REQUIRE(std::abs(mm - 1000) < 40);
    }
  };
  bench.run(session);
  CHECK(client.statistics().bad >= 299);
  CHECK(static_cast<int>(client.statistics().bad) <= damaged);
}

TEST_CASE("a lidar that sends nothing but damage is given up with a count") {
  Bench bench;
  set_fault(bench, [](std::string message) {
    message[message.size() / 2] = static_cast<char>(message[message.size() / 2] ^ 1);
    return message;
  });
  lidar::Client client = bench.client();
  std::string what;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    co_await client.next();
  };
  CHECK(kind_of_failure([&] { bench.run(session); }, &what) == Kind::bad_answer);
  CHECK_THAT(what, Contains("20 scans in a row"));
}

TEST_CASE("scans from before a stop are never delivered after it") {
  Bench bench;
  std::string old_scan;
  std::uint64_t last_of_first = 0;
  bool replay = false;
  sim::ScipServer::Fault fault;
  fault.to_host = [&](std::string bytes, bool&) {
    for (const std::string& message : messages_in(bytes))
      if (!replay && is_scan(message)) old_scan = message;
    return replay ? old_scan + bytes + old_scan : bytes;
  };
  bench.server.set_fault(fault);
  lidar::Client client = bench.client();
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    for (int i = 0; i < 50; ++i) last_of_first = (co_await client.next()).device_ms;
    co_await client.stop();
    replay = true;  // the first stream's last scan comes again before and after everything
    co_await client.start(all);
    for (int i = 0; i < 50; ++i) {
      const lidar::Scan scan = co_await client.next();
      REQUIRE(scan.device_ms > last_of_first);
    }
    replay = false;
    co_await client.stop();
  };
  bench.run(session);
  CHECK(client.statistics().stale >= 2);
  CHECK(client.statistics().bad == 0);
}

TEST_CASE("garbage in a stream costs the scans that it hit and no more") {
  Bench bench;
  std::minstd_rand random(3);
  int seen = 0, hit = 0;
  set_fault(bench, [&](std::string message) {
    if (++seen % 10 != 5) return message;
    ++hit;
    std::string noise(random() % 3000, ' ');
    for (char& c : noise) c = static_cast<char>(random() >> 8);
    return message.substr(0, random() % message.size()) + noise + "\n\n";
  });
  lidar::Client client = bench.client();
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    for (int i = 0; i < 300; ++i) {
      const lidar::Scan scan = co_await client.next();
      REQUIRE(std::abs(scan.range_mm[540] - 1000) < 40);
    }
  };
  bench.run(session);
  CHECK(client.statistics().lost > 20);
  CHECK(static_cast<int>(client.statistics().lost) <= hit);
}

TEST_CASE("an answer in the middle of a scan costs that scan only") {
  // Firmware has been seen to put the answer to II inside a scan (urg_stamped #135).
  Bench bench;
  int seen = 0;
  set_fault(bench, [&](std::string message) {
    if (++seen != 20) return message;
    return message.insert(3000, "II\n00P\nTIME:000000;5\n\n");
  });
  lidar::Client client = bench.client();
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    for (int i = 0; i < 60; ++i) co_await client.next();
  };
  bench.run(session);
  CHECK(client.statistics().lost == 1);
  CHECK(client.statistics().bad <= 2);
}

TEST_CASE("a noise without an end in a stream is given up in time") {
  Bench bench;
  int seen = 0;
  set_fault(bench, [&](std::string message) {
    if (++seen < 20) return message;
    return std::string(message.size(), 'x');
  });
  lidar::Client client = bench.client(impatient());
  const auto begun = steady_clock::now();
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    while (true) co_await client.next();
  };
  const Kind kind = kind_of_failure([&] { bench.run(session); });
  CHECK((kind == Kind::bad_answer || kind == Kind::no_answer));
  CHECK(steady_clock::now() - begun < deadline);
}

TEST_CASE("a lidar that does not know ME is asked once, is not lost, and measures distances") {
  Bench bench;
  int asked = 0;
  sim::ScipServer::Fault fault;
  fault.to_device = [&](std::string bytes) {  // ME becomes a command that nobody knows.
    const std::size_t at = bytes.find("ME0");
    if (at == std::string::npos) return bytes;
    ++asked;
    return bytes.replace(at, 2, "MX");
  };
  fault.to_host = [](std::string bytes, bool&) {
    const std::size_t at = bytes.find("MX0");
    return at == std::string::npos ? bytes : bytes.replace(at, 2, "ME");
  };
  bench.server.set_fault(fault);
  lidar::Client client = bench.client();
  Kind kind = Kind::wrong_use;
  std::string what;
  lidar::Scan scan;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    try {
      co_await client.start(all);
    } catch (const lidar::LidarError& error) {
      kind = error.kind();
      what = error.what();
    }
    all.with_intensity = false;
    co_await client.start(all);
    scan = co_await client.next();
    co_await client.stop();
  };
  bench.run(session);
  CHECK(kind == Kind::unknown_command);
  CHECK_THAT(what, Contains("does not know ME") && !Contains("Switch it off"));
  CHECK(asked == 1);
  CHECK(scan.range_mm.size() == 1081);
  CHECK(scan.intensity.empty());
}

TEST_CASE("a lidar that checks itself is waited for; one that is broken is reported") {
  Bench bench;
  int seen = 0;
  const std::string passing = GENERATE("21", "0M");
  std::string status = passing;
  set_fault(bench, [&](std::string message) {
    if (++seen != 10) return message;
    std::string line = message.substr(0, message.find('\n'));
    std::string out = lidar::build_status_response(line, status);
    if (status == passing) out += lidar::build_status_response(line, "98");
    return out;
  });
  lidar::Client client = bench.client();
  std::string what;
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    lidar::StreamRequest all;
    co_await client.start(all);
    for (int i = 0; i < 40; ++i) co_await client.next();
    co_await client.stop();
    seen = 0;
    status = "51";
    co_await client.start(all);
    while (true) co_await client.next();
  };
  CHECK(kind_of_failure([&] { bench.run(session); }, &what) == Kind::hardware_fault);
  CHECK_THAT(what, Contains("51") && Contains("Switch it off and on"));
  CHECK(client.statistics().scans >= 40);
}

}  // namespace lidar_stream_faults_test
