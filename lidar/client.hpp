// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/awaitable.hpp>
#include <chrono>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>

#include "lidar/clock_estimator.hpp"
#include "lidar/identity.hpp"
#include "lidar/scan.hpp"

namespace lidar {

/// What the driver could not do. what() says what happened, what was done about it and what to do next.
class LidarError : public std::runtime_error {
 public:
  enum class Kind {
    cannot_connect,   ///< Nothing listens, or the port is refused.
    not_a_lidar,      ///< Something answers, but not in SCIP.
    no_answer,        ///< The lidar did not answer in time.
    connection_lost,  ///< The connection closed or broke.
    refused,          ///< The lidar understood and said no.
    hardware_fault,   ///< The lidar reports a fault of its own.
    bad_answer,       ///< Answers arrive, but garbled.
    wrong_use,        ///< A step range, cluster or order of calls that cannot work.
    unknown_address,  ///< The host's name is not known.
    unknown_command,  ///< The lidar does not know the command at all: ME, say, when it has no intensities.
    in_use,           ///< It does not answer, and another program on this computer is connected to it.
  };
  LidarError(Kind kind, const std::string& what) : std::runtime_error(what), kind_(kind) {}
  [[nodiscard]] Kind kind() const { return kind_; }

 private:
  Kind kind_;
};

/// Which scans to send. Steps are the device's, first and last included; a cluster of n merges n steps into
/// one value; `skip` scans are left out between two that are sent.
struct StreamRequest {
  int first_step = 0, last_step = 1080;
  int cluster = 1;
  int skip = 0;
  bool with_intensity = true;

  StreamRequest() = default;
  StreamRequest(int first_step_, int last_step_, int cluster_ = 1, int skip_ = 0, bool with_intensity_ = true)
      : first_step(first_step_),
        last_step(last_step_),
        cluster(cluster_),
        skip(skip_),
        with_intensity(with_intensity_) {}
};

struct Options {
  std::chrono::milliseconds connect_timeout{
      1500};  ///< Over a second: a lost first packet is sent again then.
  std::chrono::milliseconds reply_timeout{
      1000};  ///< For one answer; requests that may be repeated are, twice.
  std::chrono::milliseconds scan_timeout{2000};  ///< Longest silence while streaming.
  std::chrono::milliseconds stop_timeout{
      10000};  ///< For QT to be acknowledged and the stream to end, backed up or not.
  std::chrono::milliseconds quiet{
      60};  ///< Least silence that counts as the stream's end; more where scans come more rarely.
  int max_bad_scans = 20;  ///< So many damaged scans in a row end next() with bad_answer.

  Options() {
  }  // NOLINT: a user-provided constructor keeps g++ 12 from destroying temporaries twice in co_await.
};

/// What came over the connections since the first connect().
struct Statistics {
  std::uint64_t scans = 0;           ///< Delivered by next().
  std::uint64_t lost = 0;            ///< Missing between two delivered ones, by the device's stamps.
  std::uint64_t bad = 0;             ///< Scans and answers that arrived damaged and were dropped.
  std::uint64_t repeated = 0;        ///< Scans whose stamp was not later than the one before; dropped.
  std::uint64_t stale = 0;           ///< Of an earlier request, dropped.
  std::uint64_t strays = 0;          ///< Other answers that nobody waited for.
  std::uint64_t resynchronised = 0;  ///< Times the stream was out of step and was found again.
  std::uint64_t bytes = 0;           ///< Received.
  std::uint64_t reconnects = 0;
  std::uint64_t failed_connects = 0;  ///< Attempts to connect that came to nothing.
};

/// A SCIP 2.x lidar on TCP. One io_context, one thread; one call at a time. Every wait has a deadline. When a
/// call that talks to the lidar is cancelled, it sends QT before it ends, so the laser is off (start() again
/// to go on).
///
///   Client lidar(co_await this_coro::executor, "192.168.0.10", 10940, Options{});
///   Identity identity = co_await lidar.connect();
///   co_await lidar.synchronise();
///   StreamRequest all;
///   co_await lidar.start(all);
///   Scan scan = co_await lidar.next();
///   co_await lidar.stop();
///
/// All calls throw LidarError, and boost::system::system_error (operation_aborted) when cancelled.
class Client {
 public:
  Client(boost::asio::any_io_executor executor, std::string host, std::uint16_t port, Options options = {});
  ~Client();  ///< Sends QT, if it can be done without waiting, and closes.
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  /// Connects, ends what an earlier client left running (stream, time-adjust mode) and identifies the lidar.
  boost::asio::awaitable<Identity> connect();
  /// Closes what is left of the connection, connects again and checks that the same lidar (serial number)
  /// answers. Does not start a stream.
  boost::asio::awaitable<Identity> reconnect();
  /// Starts a stream. Scans of any earlier request are never delivered after it. A stream that runs is
  /// stopped first.
  boost::asio::awaitable<void> start(StreamRequest request);
  /// The next good scan. Damaged ones are dropped and counted. Ranges below DMIN, above DMAX and codes are 0.
  boost::asio::awaitable<Scan> next();
  /// Takes back a scan that is done with, so that one of the next need not ask for memory: for who reads many
  /// a second.
  void reuse(Scan scan);
  /// QT until it is acknowledged and the stream is silent. Does nothing when nothing streams. A lidar that
  /// refuses QT may still have its laser on: that is an error, silent or not.
  boost::asio::awaitable<void> stop();
  /// TM0, TM1 with unique strings, TM2: how the clocks stand. Not while streaming (stops the stream).
  boost::asio::awaitable<ClockEstimate> synchronise();
  /// Closes the connection at once.
  void close();

  [[nodiscard]] bool connected() const;
  [[nodiscard]] bool streaming() const;
  [[nodiscard]] const Identity& identity() const;  ///< Of the last connect().
  [[nodiscard]] Statistics statistics() const;
  [[nodiscard]] ClockEstimate clock() const;  ///< As of the last scan or exchange.

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lidar
