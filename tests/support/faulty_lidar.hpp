// SPDX-License-Identifier: MIT
#pragma once
// A lidar that the driver meets over a real socket, with a fault on the way, or something else in its place.

#include <boost/asio/as_tuple.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/streambuf.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/asio/write.hpp>
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/lidar_bench.hpp"

namespace faulty_lidar {

namespace asio = boost::asio;
using asio::awaitable;
using asio::ip::tcp;
using lidar_bench::Bench;
using lidar_bench::kind_of_failure;
using Kind = lidar::LidarError::Kind;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

inline lidar::Options impatient() {
  lidar::Options options;
  options.connect_timeout = milliseconds(300);
  options.reply_timeout = milliseconds(60);
  options.scan_timeout = milliseconds(150);
  options.stop_timeout = milliseconds(250);
  options.quiet = milliseconds(10);
  return options;
}
/// Longest time that connect() may take with these: QT until it is given up, and three requests asked thrice.
inline constexpr auto deadline = milliseconds(2000);

/// Cuts what a simulated lidar sends into its messages, so that a fault can act on each.
inline std::vector<std::string> messages_in(const std::string& bytes) {
  std::vector<std::string> out;
  std::size_t begin = 0;
  for (std::size_t end = bytes.find("\n\n"); end != std::string::npos; end = bytes.find("\n\n", begin)) {
    out.push_back(bytes.substr(begin, end + 2 - begin));
    begin = end + 2;
  }
  if (begin < bytes.size()) out.push_back(bytes.substr(begin));
  return out;
}
inline bool is_scan(const std::string& message) { return message.find("\n99b\n") != std::string::npos; }

/// A lidar whose stream each message passes a fault on its way.
inline void set_fault(Bench& bench, const std::function<std::string(std::string)>& on_scan) {
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
inline awaitable<bool> write(tcp::socket& socket, std::string bytes) {
  const auto [failed, n] =
      co_await asio::async_write(socket, asio::buffer(bytes), asio::as_tuple(asio::use_awaitable));
  co_return !failed;
}

/// Answers a host as the device does until it sends a line that begins so; that line, or nothing when it has
/// gone.
inline awaitable<std::string> answer_until(tcp::socket& socket, sim::UstDevice& device, std::string begins) {
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
inline Kind failure_of_connect(Listener& listener, std::string* what = nullptr) {
  lidar::Client client = listener.client(impatient());
  const auto begun = steady_clock::now();
  const Kind kind =
      kind_of_failure([&] { listener.run([&]() -> awaitable<void> { co_await client.connect(); }); }, what);
  CHECK(steady_clock::now() - begun < deadline);
  CHECK_FALSE(client.connected());
  return kind;
}

}  // namespace faulty_lidar
