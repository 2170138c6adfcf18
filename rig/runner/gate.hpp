// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/this_coro.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <memory>
#include <utility>

namespace rig {

/// One coroutine waits until another opens it, and does not wait where it is open. It may be closed again.
class Gate {
 public:
  boost::asio::awaitable<void> wait() {
    while (!open_) {
      boost::asio::steady_timer timer(co_await boost::asio::this_coro::executor,
                                      boost::asio::steady_timer::time_point::max());
      const Waiting waiting(waiting_, timer);
      boost::system::error_code ignored;
      co_await timer.async_wait(boost::asio::redirect_error(boost::asio::use_awaitable, ignored));
      const auto cancelled = co_await boost::asio::this_coro::cancellation_state;
      if (cancelled.cancelled() != boost::asio::cancellation_type::none) co_return;
    }
  }
  void open() {
    open_ = true;
    if (*waiting_) (*waiting_)->cancel();
  }
  void close() { open_ = false; }
  [[nodiscard]] bool is_open() const { return open_; }

 private:
  using Waker = std::shared_ptr<boost::asio::steady_timer*>;

  /// The timer lies in the coroutine, which may be destroyed while it waits: after the gate, too.
  class Waiting {
   public:
    Waiting(Waker waker, boost::asio::steady_timer& timer) : waker_(std::move(waker)) { *waker_ = &timer; }
    ~Waiting() { *waker_ = nullptr; }
    Waiting(const Waiting&) = delete;
    Waiting& operator=(const Waiting&) = delete;

   private:
    Waker waker_;
  };

  bool open_ = false;
  Waker waiting_ = std::make_shared<boost::asio::steady_timer*>(nullptr);
};

}  // namespace rig
