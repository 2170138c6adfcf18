// SPDX-License-Identifier: MIT
#pragma once
// What the units of the driver share: requests (client_requests.cpp), connection (client_connection.cpp),
// stream of scans (client_stream.cpp), clock and public face (client.cpp).

#include <boost/asio/awaitable.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/this_coro.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "lidar/client.hpp"
#include "lidar/frame_reader.hpp"
#include "lidar/identity.hpp"
#include "lidar/request.hpp"
#include "lidar/scan_receiver.hpp"
#include "lidar/watchdog.hpp"

namespace lidar {

namespace asio = boost::asio;
using asio::awaitable;
using asio::redirect_error;
using asio::use_awaitable;
using asio::ip::tcp;
using boost::system::error_code;
using std::chrono::steady_clock;
using Kind = LidarError::Kind;

constexpr int attempts = 3;  // of a request that may be repeated without harm

inline std::int64_t now_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(steady_clock::now().time_since_epoch())
      .count();
}

struct Client::Impl {
  Impl(asio::any_io_executor executor_, std::string host_, std::uint16_t port_, Options options_)
      : executor(std::move(executor_)),
        host(std::move(host_)),
        port(port_),
        options(options_),
        socket(executor),
        watchdog(std::make_shared<Watchdog>(executor)) {}
  ~Impl() { watchdog->stop(); }

  asio::any_io_executor executor;
  std::string host;
  std::uint16_t port;
  Options options;
  tcp::socket socket;
  tcp::endpoint peer;  ///< Of the present connection, or the last.
  std::uint16_t own_port = 0;
  std::shared_ptr<Watchdog> watchdog;
  FrameReader reader;
  Identity identity;
  Statistics statistics;
  ClockEstimator clock;
  StreamRequest request;
  std::string stream_echo, stream_tag;  ///< What a scan's echo begins and ends with.
  ScanCommand stream_command;
  Scan spare;             ///< Memory for a scan to come; what it says means nothing.
  ScanReceiver receiver;  ///< Takes what is as expected; the rest goes the long way.
  bool connected = false, streaming = false;
  unsigned requests = 0;
  int bad_in_a_row = 0;
  int repeated_in_a_row = 0;
  std::uint64_t last_scan_ms = 0;
  bool scan_seen = false;
  std::optional<std::uint32_t> last_stamp;  ///< Of a scan, as it came, on whatever connection.
  unsigned damaged_answers = 0;             ///< To our own requests, on this connection.
  std::string last_stray;                   ///< First line and status of what came in the stream's place.
  unsigned attempts_failed = 0;             ///< To connect, in a row.
  steady_clock::time_point first_attempt{};
  std::int64_t arrived_us = 0;  ///< When the bytes of the present frame were read.

  [[nodiscard]] std::string address() const { return host + ":" + std::to_string(port); }

  void close() {
    error_code ignored;
    socket.close(ignored);
    watchdog->stop();
    reader.clear();
    connected = streaming = false;
  }

  [[noreturn]] void fail(Kind kind, const std::string& what) {
    if (kind == Kind::connection_lost) close();
    throw LidarError(kind, what);
  }

  [[noreturn]] void broken(const error_code& failed, const std::string& during);
  awaitable<bool> fill(steady_clock::time_point until, const char* during);
  awaitable<void> send(std::string bytes, const char* during);

  std::string next_tag() { return "r" + std::to_string(requests++ % 1000000); }

  /// What the lidar said to a request: copies, because the reader's bytes do not stay.
  struct Answer {
    Answer(std::string status_, std::string body_) : status(std::move(status_)), body(std::move(body_)) {}
    std::string status, body;
  };
  awaitable<std::optional<Answer>> answer_to(const std::string& line, steady_clock::time_point until);
  awaitable<std::optional<Answer>> exchange(Request wanted);
  awaitable<std::string> ask(Request request_);
  awaitable<void> open();
  awaitable<error_code> connect_to_any(tcp::resolver::results_type found);
  awaitable<tcp::resolver::results_type> resolve(steady_clock::time_point until);
  [[nodiscard]] steady_clock::duration silence() const;
  awaitable<bool> falls_silent(steady_clock::time_point until);
  awaitable<void> end_stream();
  awaitable<void> leave_time_adjust();
  awaitable<Identity> identify();
  awaitable<Identity> connect();
  awaitable<Identity> connect_once();
  awaitable<void> wake();
  awaitable<Identity> connect_first();
  awaitable<Identity> reconnect();
  awaitable<void> start(StreamRequest wanted);
  awaitable<Scan> next();
  awaitable<Scan> next_to_come();
  awaitable<void> stop();
  awaitable<ClockEstimate> synchronise();
  awaitable<void> exchange_times();
  [[nodiscard]] std::string other_connection() const;
  std::optional<Scan> scan_in(const Frame& frame);
  std::optional<Scan> scan_at_hand();
  bool place_in_time(Scan& scan, std::uint32_t stamp);
  void count_repetition();
  [[nodiscard]] std::optional<Frame> scan_frame_in_damaged(std::string_view bytes) const;
  void judge_stream_status(const Frame& frame);
  void count_damage(const std::string& what);
  awaitable<void> no_scan_came();
  awaitable<std::string> state_of_lidar();
};

/// Runs what talks to the lidar; whatever ends it, a stream that was running when it was cancelled is ended,
/// so that the laser is off.
template <class Impl, class T>
awaitable<T> ending_in_silence(Impl& impl, awaitable<T> work) {
  std::exception_ptr why;
  try {
    if constexpr (std::is_void_v<T>) {
      co_await std::move(work);
      co_return;
    } else {
      co_return co_await std::move(work);
    }
  } catch (const boost::system::system_error&) {
    why = std::current_exception();
  }
  co_await asio::this_coro::reset_cancellation_state(asio::disable_cancellation());
  if (impl.connected) {
    try {
      co_await impl.end_stream();
    } catch (const LidarError&) {  // it was to be left anyway; the caller learns of the cancellation
    }
  }
  std::rethrow_exception(why);
}

}  // namespace lidar
