// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <memory>

namespace lidar {

/// One timer for all deadlines, so that a deadline costs a comparison and not a timer for each read: it
/// cancels the socket's operations once `deadline` has passed, and looks again when it was put off.
struct Watchdog : std::enable_shared_from_this<Watchdog> {
  explicit Watchdog(const boost::asio::any_io_executor& executor_) : timer(executor_) {}
  static constexpr auto never = std::chrono::steady_clock::time_point::max();
  boost::asio::steady_timer timer;
  boost::asio::ip::tcp::socket* guarded = nullptr;
  std::chrono::steady_clock::time_point deadline = never;
  bool armed = false, expired = false;

  void guard(boost::asio::ip::tcp::socket& what, std::chrono::steady_clock::time_point until) {
    guarded = &what;
    deadline = until;
    expired = false;
    if (!armed || until < timer.expiry()) arm();
  }
  void relax() { deadline = never; }
  void stop() {
    relax();
    guarded = nullptr;
    armed = false;
    timer.cancel();
  }
  void arm() {
    armed = true;
    timer.expires_at(deadline);
    timer.async_wait([self = shared_from_this()](const boost::system::error_code& failed) {
      if (failed) return;  // moved to an earlier time, or stopped
      self->armed = false;
      if (self->deadline == never || !self->guarded) return;
      if (std::chrono::steady_clock::now() < self->deadline) return self->arm();
      self->expired = true;
      boost::system::error_code ignored;
      self->guarded->cancel(ignored);
    });
  }
};

}  // namespace lidar
