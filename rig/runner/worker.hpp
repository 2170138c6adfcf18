// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/awaitable.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/this_coro.hpp>
#include <boost/asio/thread_pool.hpp>
#include <future>
#include <memory>
#include <type_traits>

#include "rig/runner/gate.hpp"

namespace rig {

/// The one thread beside the I/O thread: fits and reports are computed there. Destroying it waits for what it
/// computes.
class Worker {
 public:
  /// What `work` returns or throws, computed while the I/O thread goes on. Calling the wait off ends it at
  /// once. The work goes on and its result is thrown away, so `work` owns all that it uses.
  template <typename Work>
  boost::asio::awaitable<std::invoke_result_t<Work&>> compute(Work work);
  /// Also after a wait that was called off.
  [[nodiscard]] bool computing() const { return computing_; }

 private:
  bool computing_ = false;
  boost::asio::thread_pool thread_{1};
};

template <typename Work>
boost::asio::awaitable<std::invoke_result_t<Work&>> Worker::compute(Work work) {
  const auto here = co_await boost::asio::this_coro::executor;
  const auto done = std::make_shared<Gate>();
  std::packaged_task<std::invoke_result_t<Work&>()> task(std::move(work));
  auto result = task.get_future();
  boost::asio::post(thread_, [here, done, task = std::move(task)]() mutable {
    task();
    boost::asio::post(here, [done] { done->open(); });
  });
  computing_ = true;
  co_await done->wait();
  if (!done->is_open()) throw boost::system::system_error(boost::asio::error::operation_aborted);
  computing_ = false;
  co_return result.get();
}

}  // namespace rig
