// SPDX-License-Identifier: MIT
#include "rig/stage/stage_patience.hpp"

#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <chrono>

#include "rig/errors.hpp"

namespace rig {

boost::asio::awaitable<std::unique_ptr<Stage>> open_stage_patiently(boost::asio::any_io_executor executor,
                                                                    std::string url, StageOptions options) {
  constexpr auto pause = std::chrono::milliseconds(100);
  constexpr int longest_tries = 30;
  boost::asio::steady_timer timer(executor);
  for (int tries = 1;; ++tries) {
    try {
      co_return co_await open_stage(executor, url, options);
    } catch (const StageBusy&) {
      if (tries >= longest_tries) throw;
    }
    timer.expires_after(pause);
    co_await timer.async_wait(boost::asio::use_awaitable);
  }
}

}  // namespace rig
