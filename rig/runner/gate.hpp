// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/this_coro.hpp>
#include <boost/asio/use_awaitable.hpp>

namespace rig {

/// Opens once; waiting for an open gate returns at once.
class Gate {
 public:
  boost::asio::awaitable<void> wait() {
    while (!open_) {
      boost::asio::steady_timer timer(co_await boost::asio::this_coro::executor,
                                      boost::asio::steady_timer::time_point::max());
      waiting_ = &timer;
      boost::system::error_code ignored;
      co_await timer.async_wait(boost::asio::redirect_error(boost::asio::use_awaitable, ignored));
      waiting_ = nullptr;
      const auto cancelled = co_await boost::asio::this_coro::cancellation_state;
      if (cancelled.cancelled() != boost::asio::cancellation_type::none) co_return;
    }
  }
  void open() {
    open_ = true;
    if (waiting_) waiting_->cancel();
  }
  void close() { open_ = false; }
  [[nodiscard]] bool is_open() const { return open_; }

 private:
  bool open_ = false;
  boost::asio::steady_timer* waiting_ = nullptr;
};

}  // namespace rig
