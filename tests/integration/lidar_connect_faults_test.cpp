// SPDX-License-Identifier: MIT
// What goes wrong between a lidar and its driver, over real sockets: each ends in recovery or in an error
// that names the fault, within its deadline. Connecting to what is no lidar, or none that answers.
#include <catch2/catch.hpp>
#include <random>

#include "tests/support/faulty_lidar.hpp"

namespace lidar_connect_faults_test {

using Catch::Matchers::Contains;
using namespace faulty_lidar;

TEST_CASE("another service on the lidar's port is told apart") {
  SECTION("a web server") {
    Listener web([](tcp::socket& socket) -> awaitable<void> {
      char bytes[256];
      co_await socket.async_read_some(asio::buffer(bytes), asio::as_tuple(asio::use_awaitable));
      co_await write(socket, "HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
      socket.close();
    });
    std::string what;
    CHECK(failure_of_connect(web, &what) == Kind::not_a_lidar);
    CHECK_THAT(what, Contains("closes the connection") && Contains("10940"));
  }
  SECTION("a service that greets and waits") {
    Listener greeter([](tcp::socket& socket) -> awaitable<void> {
      co_await write(socket, "SSH-2.0-Something_1.0\r\n");
      asio::streambuf rest;
      co_await asio::async_read(socket, rest, asio::as_tuple(asio::use_awaitable));
    });
    std::string what;
    CHECK(failure_of_connect(greeter, &what) == Kind::not_a_lidar);
    CHECK_THAT(what, Contains("does not answer in SCIP"));
  }
  SECTION("an echo") {
    Listener echo([](tcp::socket& socket) -> awaitable<void> {
      char bytes[256];
      while (true) {
        const auto [failed, n] =
            co_await socket.async_read_some(asio::buffer(bytes), asio::as_tuple(asio::use_awaitable));
        if (failed) co_return;
        auto writing = write(socket, std::string(bytes, n));
        if (!co_await std::move(writing)) co_return;
      }
    });
    CHECK(failure_of_connect(echo) == Kind::not_a_lidar);
  }
  SECTION("a line without an end") {
    Listener flood([](tcp::socket& socket) -> awaitable<void> {
      while (true) {
        auto writing = write(socket, std::string(100000, 'A'));
        if (!co_await std::move(writing)) co_return;
      }
    });
    CHECK(failure_of_connect(flood) == Kind::not_a_lidar);
  }
  SECTION("empty lines without an end") {
    Listener flood([](tcp::socket& socket) -> awaitable<void> {
      while (true) {
        auto writing = write(socket, std::string(100000, '\n'));
        if (!co_await std::move(writing)) co_return;
      }
    });
    CHECK(failure_of_connect(flood) == Kind::not_a_lidar);
  }
  SECTION("noise") {
    Listener noise([](tcp::socket& socket) -> awaitable<void> {
      std::minstd_rand random(1);
      while (true) {
        std::string bytes(50000, ' ');
        for (char& c : bytes) c = static_cast<char>(random() >> 8);
        auto writing = write(socket, std::move(bytes));
        if (!co_await std::move(writing)) co_return;
      }
    });
    CHECK(failure_of_connect(noise) == Kind::not_a_lidar);
  }
}

TEST_CASE("a lidar that is in another program's hands is reported as that") {
  Bench bench;
  lidar::Client first = bench.client(), second = bench.client(impatient());
  std::string what;
  auto session = [&]() -> awaitable<void> {
    co_await first.connect();
    co_await second.connect();  // waits in the device's queue, unanswered
  };
  const auto begun = steady_clock::now();
  CHECK(kind_of_failure([&] { bench.run(session); }, &what) == Kind::in_use);
  CHECK(steady_clock::now() - begun < deadline);
  CHECK_THAT(what, Contains("process " + std::to_string(::getpid())));
}

TEST_CASE("an address that nobody has, and a name that nobody knows, are reported in time") {
  asio::io_context io{1};
  const std::vector<std::pair<const char*, Kind>> hosts = {
      {"192.0.2.1", Kind::cannot_connect},
      {"no-such-host.invalid", Kind::unknown_address}};  // RFC 5737, 6761
  for (const auto& [host, kind] : hosts) {
    lidar::Client client(io.get_executor(), host, 10940, impatient());
    const auto begun = steady_clock::now();
    std::exception_ptr why;
    asio::co_spawn(io, client.connect(), [&](std::exception_ptr failed, const lidar::Identity&) {
      why = failed;
      io.stop();
    });
    io.restart();
    io.run_for(std::chrono::seconds(20));
    REQUIRE(why);
    std::string what;
    CHECK(kind_of_failure([&] { std::rethrow_exception(why); }, &what) == kind);
    CHECK_THAT(what, Contains(host));
    CHECK(steady_clock::now() - begun < deadline);
  }
}

TEST_CASE("answers that were damaged at first do not count against a later stop") {
  Bench bench;
  int damaged_parameters = 0, damaged_stops = 0;
  bool stopping = false;
  sim::ScipServer::Fault fault;
  fault.to_host = [&](std::string bytes, bool&) {
    const bool hit = (bytes.starts_with("PP") && damaged_parameters < 2 && ++damaged_parameters) ||
                     (bytes.starts_with("QT") && stopping && damaged_stops < 2 && ++damaged_stops);
    if (hit) bytes[bytes.find('\n') + 1] ^= 1;  // Of the status.
    return bytes;
  };
  bench.server.set_fault(fault);
  lidar::Client client = bench.client();
  auto session = [&]() -> awaitable<void> {
    co_await client.connect();
    co_await client.start(lidar::StreamRequest());
    co_await client.next();
    stopping = true;
    co_await client.stop();
  };
  CHECK_NOTHROW(bench.run(session));
  CHECK(damaged_parameters == 2);
  CHECK(damaged_stops == 2);
}

TEST_CASE("a lidar whose answers cannot be read is reported as that") {
  Bench bench;
  sim::ScipServer::Fault fault;
  fault.to_host = [](std::string bytes, bool&) {
    if (bytes.find("PP") == 0) bytes[bytes.find("AMAX") + 6] ^= 1;
    return bytes;
  };
  bench.server.set_fault(fault);
  lidar::Client client = bench.client(impatient());
  std::string what;
  CHECK(kind_of_failure([&] { bench.run([&]() -> awaitable<void> { co_await client.connect(); }); }, &what) ==
        Kind::bad_answer);
  CHECK_THAT(what, Contains("PP is damaged"));
}

}  // namespace lidar_connect_faults_test
