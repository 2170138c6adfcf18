// SPDX-License-Identifier: MIT
// The lidar driver over loopback TCP: full ME scans as fast as they come, beside a sink that reads the same
// bytes; and the processor time it takes at the 40 scans a second of a real lidar.
#include <arpa/inet.h>
#include <benchmark/benchmark.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <thread>

#include "lidar/client.hpp"
#include "lidar/encoding.hpp"
#include "lidar/response.hpp"

namespace {

constexpr int beams = 1081, scans_in_block = 32;

/// Answers as a lidar does while it is set up, then sends scans as fast as they are taken, or 40 a second,
/// until QT.
class Source {
 public:
  explicit Source(bool real_time) : real_time_(real_time), listener_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    auto* const any = reinterpret_cast<sockaddr*>(&address);
    if (bind(listener_, any, size) != 0 || listen(listener_, 1) != 0 ||
        getsockname(listener_, any, &size) != 0)
      std::abort();
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this] { serve(); });
  }
  ~Source() {
    ended_ = true;
    shutdown(listener_, SHUT_RDWR);
    thread_.join();
    close(listener_);
  }
  [[nodiscard]] std::uint16_t port() const { return port_; }

 private:
  void serve() {
    const int host = accept(listener_, nullptr, nullptr);
    if (host < 0) return;
    const int on = 1;
    setsockopt(host, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    lidar::RequestReader requests;
    while (!ended_) {
      pollfd ready{host, POLLIN, 0};
      poll(&ready, 1, streaming_ ? (real_time_ ? wait_ms() : 0) : 100);
      if (ready.revents != 0) {
        char bytes[1024];
        const ssize_t n = recv(host, bytes, sizeof bytes, MSG_DONTWAIT);
        if (n == 0) break;
        if (n > 0) requests.feed({bytes, static_cast<std::size_t>(n)});
        for (auto line = requests.next(); line && *line; line = requests.next())
          answer(host, std::string(**line));
      }
      if (streaming_ && (!real_time_ || wait_ms() == 0)) send_scans(host);
    }
    close(host);
  }

  [[nodiscard]] int wait_ms() const {
    using namespace std::chrono;
    return static_cast<int>(
        std::max<std::int64_t>(0, ceil<milliseconds>(next_ - steady_clock::now()).count()));
  }

  void answer(int host, const std::string& line) {
    using KeyValues = std::vector<std::pair<std::string, std::string>>;
    std::string out;
    if (line.starts_with("VV")) {
      out = lidar::build_key_value_response(line, "00", KeyValues{{"PROD", "UST-10LX"}, {"SERI", "H1"}});
    } else if (line.starts_with("PP")) {
      out = lidar::build_key_value_response(line, "00",
                                            KeyValues{{"MODL", "UST-10LX"},
                                                      {"DMIN", "20"},
                                                      {"DMAX", "30000"},
                                                      {"ARES", "1440"},
                                                      {"AMIN", "0"},
                                                      {"AMAX", "1080"},
                                                      {"AFRT", "540"},
                                                      {"SCAN", "2400"}});
    } else if (line.starts_with("II")) {
      out = lidar::build_key_value_response(line, "00", KeyValues{{"LASR", "OFF"}});
    } else {
      streaming_ = line.starts_with("ME");
      out = lidar::build_status_response(line, "00");
      if (streaming_) prepare(line);
      next_ = std::chrono::steady_clock::now();
    }
    write_all(host, out);
  }

  void prepare(const std::string& echo) {
    std::vector<std::uint32_t> range(beams), intensity(beams, 1000);
    for (std::size_t i = 0; i < range.size(); ++i) range[i] = static_cast<std::uint32_t>(1000 + i);
    lidar::ScanData data;
    data.range_mm = range;
    data.intensity = intensity;
    block_.clear();
    for (int i = 0; i < (real_time_ ? 1 : scans_in_block); ++i)
      append_scan_response(block_, echo, "99", lidar::ScanCommand(), data);
    stamp_at_ = echo.size() + 5;
    message_bytes_ = block_.size() / (real_time_ ? 1 : scans_in_block);
  }

  void send_scans(int host) {
    for (std::size_t at = stamp_at_; at < block_.size(); at += message_bytes_) {
      std::string stamp;
      lidar::append_value(stamp, (stamp_ms_ += 25) & 0xFFFFFF, 4);
      stamp += lidar::checksum(stamp);
      block_.replace(at, stamp.size(), stamp);
    }
    write_all(host, block_);
    next_ += std::chrono::milliseconds(25);
  }

  void write_all(int host, const std::string& bytes) {
    for (std::size_t at = 0; at < bytes.size() && !ended_;) {
      const ssize_t n = send(host, bytes.data() + at, bytes.size() - at, MSG_NOSIGNAL);
      if (n < 0) return void(ended_ = true);
      at += static_cast<std::size_t>(n);
    }
  }

  bool real_time_, streaming_ = false;
  int listener_;
  std::uint16_t port_ = 0;
  std::atomic<bool> ended_ = false;
  std::string block_;
  std::size_t stamp_at_ = 0, message_bytes_ = 0;
  std::uint64_t stamp_ms_ = 0;
  std::chrono::steady_clock::time_point next_;
  std::thread thread_;
};

double thread_seconds() {
  rusage used{};
  getrusage(RUSAGE_THREAD, &used);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

/// Streams for as long as the benchmark wants.
boost::asio::awaitable<void> stream(benchmark::State& state, lidar::Client& client, std::uint64_t batch) {
  co_await client.connect();
  lidar::StreamRequest all;
  co_await client.start(all);
  for (auto _ : state) {
    for (std::uint64_t i = 0; i < batch; ++i) {
      lidar::Scan scan = co_await client.next();
      benchmark::DoNotOptimize(scan.range_mm.data());
      client.reuse(std::move(scan));
    }
  }
  client.close();
}

void run(benchmark::State& state, std::uint16_t port, std::uint64_t batch) {
  boost::asio::io_context io(1);
  lidar::Client client(io.get_executor(), "127.0.0.1", port);
  std::exception_ptr why;
  auto work = stream(state, client, batch);
  boost::asio::co_spawn(io, std::move(work), [&](std::exception_ptr failed) { why = failed; });
  io.run();
  if (why) std::rethrow_exception(why);
  const lidar::Statistics seen = client.statistics();
  if (seen.lost + seen.bad > 0) state.SkipWithError("scans were lost");
}

void driver(benchmark::State& state) {
  const Source source(false);
  run(state, source.port(), 1000);
  state.SetItemsProcessed(state.iterations() * 1000);
  state.counters["goal"] = 0.5;
}

void raw_sink(benchmark::State& state) {
  const Source source(false);
  const int host = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(source.port());
  if (connect(host, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) std::abort();
  const std::string request = "ME0000108001000;r7\n";
  if (send(host, request.data(), request.size(), 0) < 0) std::abort();
  std::vector<char> buffer(64 * 1024);
  constexpr std::size_t message_bytes = 6720;
  std::size_t received = 0;
  std::int64_t scans = 0;
  for (auto _ : state) {
    for (const std::size_t until = received + 1000 * message_bytes; received < until;) {
      const ssize_t n = recv(host, buffer.data(), buffer.size(), 0);
      if (n <= 0) std::abort();
      received += static_cast<std::size_t>(n);
    }
    scans += 1000;
  }
  state.SetItemsProcessed(scans);
  close(host);
}

void at_hardware_speed(benchmark::State& state) {
  const Source source(true);
  const double used_before = thread_seconds();
  const auto begun = std::chrono::steady_clock::now();
  run(state, source.port(), 80);
  const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  state.counters["cpu_percent"] = 100 * (thread_seconds() - used_before) / elapsed;
  state.counters["cpu_percent at most"] = 1;
}

}  // namespace

BENCHMARK(driver)->Name("driver over loopback TCP/ours")->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(raw_sink)
    ->Name("driver over loopback TCP/limit:raw sink")
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(at_hardware_speed)
    ->Name("driver at 40 scans a second")
    ->UseRealTime()
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_MAIN();
