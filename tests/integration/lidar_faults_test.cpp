// SPDX-License-Identifier: MIT
// What goes wrong between a lidar and its driver, over real sockets: each ends in recovery or in an error
// that names the fault, within its deadline.
#include <unistd.h>

#include <boost/asio/as_tuple.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/streambuf.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/asio/write.hpp>
#include <random>

#include "lidar/encoding.hpp"
#include "lidar/response.hpp"
#include "tests/support/lidar_bench.hpp"

using Catch::Matchers::Contains;
namespace asio = boost::asio;
using asio::awaitable;
using asio::ip::tcp;
using lidar_bench::Bench;
using lidar_bench::kind_of_failure;
using Kind = lidar::LidarError::Kind;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

namespace {

lidar::Options impatient() {
  lidar::Options options;
  options.connect_timeout = milliseconds(300);
  options.reply_timeout = milliseconds(60);
  options.scan_timeout = milliseconds(150);
  options.stop_timeout = milliseconds(250);
  options.quiet = milliseconds(10);
  return options;
}
/// Longest time that connect() may take with these: QT until it is given up, and three requests asked thrice.
constexpr auto deadline = milliseconds(2000);

/// Cuts what a simulated lidar sends into its messages, so that a fault can act on each.
std::vector<std::string> messages_in(const std::string& bytes) {
  std::vector<std::string> out;
  std::size_t begin = 0;
  for (std::size_t end = bytes.find("\n\n"); end != std::string::npos; end = bytes.find("\n\n", begin)) {
    out.push_back(bytes.substr(begin, end + 2 - begin));
    begin = end + 2;
  }
  if (begin < bytes.size()) out.push_back(bytes.substr(begin));
  return out;
}
bool is_scan(const std::string& message) { return message.find("\n99b\n") != std::string::npos; }

/// A lidar whose stream each message passes a fault on its way.
void set_fault(Bench& bench, const std::function<std::string(std::string)>& on_scan) {
  sim::ScipServer::Fault fault;
  fault.to_host = [on_scan](const std::string& bytes, bool&) {
    std::string out;
    for (std::string& message : messages_in(bytes)) out += is_scan(message) ? on_scan(message) : message;
    return out;
  };
  bench.server.set_fault(fault);
}

/// Something that listens, and does with each connection what the test says.
struct Listener {
  using Serve = std::function<awaitable<void>(tcp::socket&)>;
  asio::io_context io{1};
  tcp::acceptor acceptor{io, {asio::ip::make_address("127.0.0.1"), 0}};
  Serve serve;

  explicit Listener(Serve serve_) : serve(std::move(serve_)) {
    auto accepting = accept_all();
    asio::co_spawn(io, std::move(accepting), asio::detached);
  }
  awaitable<void> accept_all() {
    while (true) {
      auto [failed, accepted] = co_await acceptor.async_accept(asio::as_tuple(asio::use_awaitable));
      if (failed) co_return;
      const auto socket = std::make_shared<tcp::socket>(std::move(accepted));
      auto serving = serve_one(socket);
      asio::co_spawn(io, std::move(serving), asio::detached);
    }
  }
  awaitable<void> serve_one(std::shared_ptr<tcp::socket> socket) { co_await serve(*socket); }
  template <class Make>
  void run(Make make) {
    lidar_bench::run(io, make, [this] { acceptor.close(); });
  }
  [[nodiscard]] lidar::Client client(lidar::Options options) {
    return {io.get_executor(), "127.0.0.1", acceptor.local_endpoint().port(), options};
  }
};

/// Writes; false when the host has gone.
awaitable<bool> write(tcp::socket& socket, std::string bytes) {
  const auto [failed, n] =
      co_await asio::async_write(socket, asio::buffer(bytes), asio::as_tuple(asio::use_awaitable));
  co_return !failed;
}

/// Answers a host as the device does until it sends a line that begins so; that line, or nothing when it has
/// gone.
awaitable<std::string> answer_until(tcp::socket& socket, sim::UstDevice& device, std::string begins) {
  asio::streambuf buffer;
  while (true) {
    const auto [failed, n] =
        co_await asio::async_read_until(socket, buffer, '\n', asio::as_tuple(asio::use_awaitable));
    if (failed) co_return "";
    std::string line(asio::buffers_begin(buffer.data()),
                     asio::buffers_begin(buffer.data()) + static_cast<std::ptrdiff_t>(n - 1));
    buffer.consume(n);
    if (line.starts_with(begins)) co_return line;
    auto writing = write(socket, device.handle(line, 1));
    if (!co_await std::move(writing)) co_return "";
  }
}

/// Connects with the driver and gives what that ended in.
Kind failure_of_connect(Listener& listener, std::string* what = nullptr) {
  lidar::Client client = listener.client(impatient());
  const auto begun = steady_clock::now();
  const Kind kind =
      kind_of_failure([&] { listener.run([&]() -> awaitable<void> { co_await client.connect(); }); }, what);
  CHECK(steady_clock::now() - begun < deadline);
  CHECK_FALSE(client.connected());
  return kind;
}

}  // namespace

// --- connecting to what is no lidar, or none that answers
// ----------------------------------------------------

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

// --- streams -----------------------------------------------------------------------------------------------

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

// --- connections -------------------------------------------------------------------------------------------

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
    std::optional<lidar::LidarError> told;
    const auto begun = steady_clock::now();
    try {
      while (true) last_before = (co_await client.next()).device_ms;
    } catch (const lidar::LidarError& error) {
      told = error;
    }
    REQUIRE(told);
    CHECK(told->kind() == Kind::no_answer);
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
    std::optional<lidar::LidarError> told;
    try {
      while (true) {
        const lidar::Scan scan = co_await client.next();
        last_before = scan.device_ms;
        last_host = scan.host_us;
      }
    } catch (const lidar::LidarError& error) {
      told = error;
    }
    REQUIRE(told);
    CHECK(told->kind() == Kind::connection_lost);
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
